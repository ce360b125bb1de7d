/** CRC-32 as in zlib, PNG and ZIP. */

/** Four tables of 256: the effect of a byte that 0 to 3 bytes follow ("slicing by 4", Kounavis and Berry 2008). */
const TABLES = new Uint32Array(4 * 256);
for (let byte = 0; byte < 256; byte++) {
  let value = byte;
  for (let bit = 0; bit < 8; bit++) value = value & 1 ? (value >>> 1) ^ 0xedb88320 : value >>> 1;
  TABLES[byte] = value;
}
for (let at = 256; at < TABLES.length; at++) TABLES[at] = (TABLES[at - 256] >>> 8) ^ TABLES[TABLES[at - 256] & 255];

/** CRC-32 of bytes, 0 to 2^32 - 1. */
export function crc32(data: Uint8Array): number {
  const tables = TABLES;
  const whole = data.length & ~3;
  let value = -1;
  for (let i = 0; i < whole; i += 4) {
    value ^= data[i] | (data[i + 1] << 8) | (data[i + 2] << 16) | (data[i + 3] << 24);
    value =
      tables[768 + (value & 255)] ^
      tables[512 + ((value >>> 8) & 255)] ^
      tables[256 + ((value >>> 16) & 255)] ^
      tables[value >>> 24];
  }
  for (let i = whole; i < data.length; i++) value = (value >>> 8) ^ tables[(value ^ data[i]) & 255];
  return (value ^ -1) >>> 0;
}
