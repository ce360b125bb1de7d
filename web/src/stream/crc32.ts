/** CRC-32 as in zlib, PNG and ZIP. */

const TABLE = Uint32Array.from({ length: 256 }, (_, byte) => {
  let value = byte;
  for (let bit = 0; bit < 8; bit++) value = value & 1 ? (value >>> 1) ^ 0xedb88320 : value >>> 1;
  return value;
});

/** CRC-32 of bytes, 0 to 2^32 - 1. */
export function crc32(data: Uint8Array): number {
  let value = 0xffffffff;
  for (let i = 0; i < data.length; i++) value = (value >>> 8) ^ TABLE[(value ^ data[i]) & 255];
  return (value ^ 0xffffffff) >>> 0;
}
