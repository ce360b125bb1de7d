// A reader of V3 Studio streams that was written from docs/STREAM.md alone, without a look at the other two. It shows that
// the document is enough, and the tests compare its frames with the Python reader's.
//
//   node second_reader.mjs VERSION STREAM LUMA OUT
//
// VERSION: of the document. STREAM: a folder or a .v3s file. LUMA: a folder with the decoded luma of each video, "PATH.y" with "/" in PATH replaced by
// "__": all pictures in the order of display, rows from the top, without padding (decoding H.264 is left to libav).
// OUT: a folder for the decoded frames, "RENDITION_FRAME.f64", little-endian: center (3), covariance (xx, yy, zz, xy, xz,
// yz), opacity (1), spherical harmonics ((degree + 1)^2 x red, green, blue) of each splat. Prints one JSON line per frame.

import { createHash } from "node:crypto";
import { closeSync, fstatSync, openSync, readFileSync, readSync, statSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { inflateRawSync } from "node:zlib";

const LARGEST_FILE = 2 ** 30;
const LARGEST_PAGE = 2 ** 24;

function refuse(problem, ...values) {
  throw new Error([problem, ...values.map((value) => JSON.stringify(value))].join(" "));
}

function need(condition, problem, ...values) {
  if (!condition) refuse(problem, ...values);
}

const wholeNumber = (value, least, most) => Number.isSafeInteger(value) && value >= least && value <= most;
const finite = (value) => typeof value === "number" && Math.abs(value) <= 1e9;
const sha256 = (bytes) => createHash("sha256").update(bytes).digest("hex");

// Sources: a folder, or one file (section "One file").

function folderSource(folder) {
  return (path, most) => {
    const file = join(folder, path);
    need(statSync(file).size <= most, "file is too large", path);
    return readFileSync(file);
  };
}

function archiveSource(file) {
  const handle = openSync(file, "r");
  const size = fstatSync(handle).size;
  const range = (start, length) => {
    const bytes = Buffer.alloc(length);
    need(start >= 0 && readSync(handle, bytes, 0, length, start) === length, "archive is cut");
    return bytes;
  };
  const tail = range(Math.max(0, size - 65536), Math.min(size, 65536));
  const end = tail.lastIndexOf(Buffer.from([0x50, 0x4b, 5, 6]));
  need(end >= 0, "archive has no end-of-central-directory record");
  const count = tail.readUInt16LE(end + 10);
  need(count < 0xffff, "archive is ZIP64, which this reader does not read");
  const directory = range(tail.readUInt32LE(end + 16), tail.readUInt32LE(end + 12));
  const entries = new Map();
  for (let at = 0, i = 0; i < count; i++) {
    need(directory.readUInt32LE(at) === 0x02014b50, "central directory is damaged");
    need((directory.readUInt16LE(at + 8) & 1) === 0, "entry is encrypted");
    need(directory.readUInt16LE(at + 10) === 0, "entry is compressed");
    const name = directory.toString("utf8", at + 46, at + 46 + directory.readUInt16LE(at + 28));
    need(i > 0 || name === "manifest.json", "manifest.json is not the first entry");
    entries.set(name, { size: directory.readUInt32LE(at + 24), offset: directory.readUInt32LE(at + 42) });
    at += 46 + directory.readUInt16LE(at + 28) + directory.readUInt16LE(at + 30) + directory.readUInt16LE(at + 32);
  }
  return (path, most) => {
    const entry = entries.get(path) ?? refuse("archive has no", path);
    need(entry.size <= most, "file is too large", path);
    const header = range(entry.offset, 30);
    return range(entry.offset + 30 + header.readUInt16LE(26) + header.readUInt16LE(28), entry.size);
  };
}

// The manifest and its pages.

function readManifest(source) {
  const bytes = source("manifest.json", LARGEST_FILE);
  const manifest = JSON.parse(new TextDecoder("utf-8", { fatal: true }).decode(bytes));
  need(manifest.format === "v3studio-stream", "not a stream", manifest.format);
  need(manifest.version === Number(version), "version is not that of the document", manifest.version);
  const text = bytes.toString("latin1");
  need(/^[0-9a-f]{64}$/.test(manifest.manifest_sha256), "manifest_sha256 is no SHA-256");
  need(text.split(manifest.manifest_sha256).length === 2, "manifest_sha256 occurs more than once");
  const zeroed = Buffer.from(text.replace(manifest.manifest_sha256, "0".repeat(64)), "latin1");
  need(sha256(zeroed) === manifest.manifest_sha256, "manifest.json is damaged");
  need(manifest.fps > 0 && manifest.fps <= 1000, "wrong fps", manifest.fps);
  return manifest;
}

function readFile(source, file, most = LARGEST_FILE) {
  const name = /^files\/[0-9a-f]{32}\.[a-z0-9]{1,8}$/;
  need(name.test(file.path), "not a path", file.path);
  need(file.path.slice(6, 38) === file.sha256.slice(0, 32), "not named by its content", file.path);
  need(wholeNumber(file.bytes, 0, most), "wrong size", file.path, file.bytes);
  const bytes = source(file.path, file.bytes);
  need(bytes.length === file.bytes && sha256(bytes) === file.sha256, "damaged", file.path);
  return bytes;
}

function allGroups(source, manifest) {
  const groups = [...manifest.groups];
  need(groups.length > 0, "no groups");
  for (const page of manifest.pages ?? []) {
    const content = JSON.parse(readFile(source, page, LARGEST_PAGE).toString("utf8"));
    need(content.format === "v3studio-stream-page", "not a page", page.path);
    const frames = content.groups.map((group) => group.frame_count);
    need(JSON.stringify(frames) === JSON.stringify(page.frames), "page has other groups than promised", page.path);
    groups.push(...content.groups);
  }
  let frame = 0;
  for (const [index, group] of groups.entries()) {
    need(group.index === index && group.first_frame === frame, "groups have gaps", index);
    need(wholeNumber(group.frame_count, 1, 10000), "wrong frame_count", index);
    frame += group.frame_count;
  }
  need(frame === manifest.frame_count, "frame_count is not that of the groups", frame);
  return groups;
}

const filesOf = ({ side, video }) => [side, video];
const sum = (values) => values.reduce((total, value) => total + value, 0);
const isBox = ({ min, max }) => min.every((low, k) => finite(low) && finite(max[k]) && low <= max[k]);
const isObject = (value) => typeof value === "object" && value !== null && !Array.isArray(value);

/** Everything that the manifest says beside what frames are decoded from. */
function checkRest(source, manifest, groups) {
  const { audio, fps } = manifest;
  need(typeof manifest.live === "boolean" && isBox(manifest.bounding_box), "live or bounding_box");
  need(isObject(manifest.settings) && isObject(manifest.metadata), "settings or metadata");
  const files = [...manifest.pages];
  if (audio !== null) {
    need(audio.codec === "aac" && wholeNumber(audio.sample_rate, 8000, 96000), "audio", audio);
    need(wholeNumber(audio.channels, 1, 2) && wholeNumber(audio.samples, 1, 2 ** 32) && audio.start >= 0, "audio", audio);
    need(audio.start + audio.samples / audio.sample_rate <= manifest.frame_count / fps + 0.1, "sound is too long");
    readFile(source, audio, 2 ** 28);
    files.push(audio);
  }
  for (const [k, part] of manifest.set.entries()) {
    need(part.index === k && part.first_frame === 0 && part.frame_count === 1 && part.sh_degree === 0, "set", k);
    files.push(...filesOf(part));
  }
  for (const [k, rendition] of manifest.renditions.entries()) {
    const own = groups.map((group) => group.renditions[k]);
    need(/^[a-z0-9-]{1,32}$/.test(rendition.id), "id", rendition.id);
    for (const key of ["qp", "splats"]) need(rendition[key] === Math.max(...own.map((one) => one[key])), key, rendition.id);
    need(rendition.bytes === sum(own.map((one) => one.bytes)), "bytes", rendition.id);
    const rates = own.map((one) => Math.ceil((8 * one.bytes * fps) / one.frame_count));
    need(rendition.bandwidth === Math.max(...rates), "bandwidth", rendition.id, rates);
    for (const one of [rendition, ...own]) {
      need(["none", "importance", "fine-tuned"].includes(one.pruning) && wholeNumber(one.qp, 0, 51), "pruning or qp");
      need(one.psnr_to_trained === null || finite(one.psnr_to_trained), "psnr_to_trained", one.psnr_to_trained);
    }
    for (const one of own) {
      need(one.bytes === sum(filesOf(one).map((file) => file.bytes)) && isBox(one.bounding_box), "bytes or box", one.index);
      const { dilation = 0.3 } = one;
      need(dilation >= 0.001 && dilation <= 1, "dilation", dilation);
      files.push(...filesOf(one));
    }
  }
  const once = [...new Map(files.map((file) => [file.path, file.bytes])).values()];
  need(manifest.total_bytes === sum(once) + source("manifest.json", LARGEST_FILE).length, "total_bytes");
}

/** The renditions of a group. */
function renditionsOf(manifest, group) {
  need(group.renditions.length === manifest.renditions.length, "group has other renditions than the stream", group.index);
  for (const [k, rendition] of group.renditions.entries()) {
    need(rendition.id === manifest.renditions[k].id, "group has other renditions than the stream", group.index);
    need(rendition.sh_degree === manifest.renditions[k].sh_degree, "group has another SH degree", group.index);
    for (const key of ["index", "first_frame", "frame_count"])
      need(rendition[key] === group[key], "renditions disagree", key, group.index);
  }
  return group.renditions;
}

// Videos.

const CRC_TABLE = Uint32Array.from({ length: 256 }, (_, value) => {
  for (let bit = 0; bit < 8; bit++) value = value & 1 ? (value >>> 1) ^ 0xedb88320 : value >>> 1;
  return value;
});

function crc32(bytes) {
  let crc = 0xffffffff;
  for (const byte of bytes) crc = (crc >>> 8) ^ CRC_TABLE[(crc ^ byte) & 255];
  return (crc ^ 0xffffffff) >>> 0;
}

/** The luma of all pictures of a video, one array each. */
function readVideo(source, lumaFolder, video, width, height, frames) {
  readFile(source, video);
  const luma = readFileSync(join(lumaFolder, `${video.path.replaceAll("/", "__")}.y`));
  need(luma.length === width * height * frames, "video has another size or length", video.path);
  const pictures = Array.from({ length: frames }, (_, k) => luma.subarray(k * width * height, (k + 1) * width * height));
  need(video.checks.length >= 1 && video.checks[0].picture === 0, "no check of picture 0", video.path);
  for (const check of video.checks) {
    need(wholeNumber(check.picture, 0, frames - 1), "check of a picture that is not there", video.path);
    need(crc32(pictures[check.picture]) === check.crc32, "luma differs", video.path, check.picture);
  }
  return pictures;
}

// A rendition of a group.

class Side {
  constructor(bytes) {
    this.bytes = bytes;
    this.at = 0;
  }

  take(count) {
    need(this.at + count <= this.bytes.length, "side file is too short");
    this.at += count;
    return this.bytes.subarray(this.at - count, this.at);
  }

  /** An array of `count` numbers, each a zigzag code in `width` byte planes, least significant first. */
  numbers(count, width) {
    const planes = this.take(count * width);
    return Int32Array.from({ length: count }, (_, i) => {
      let code = 0;
      for (let plane = width - 1; plane >= 0; plane--) code = code * 256 + planes[plane * count + i];
      return code % 2 === 0 ? code / 2 : -(code + 1) / 2;
    });
  }
}

/** Running sums: undoes "each minus the one before". */
function accumulated(differences) {
  let sum = 0;
  return Array.from(differences, (difference) => (sum += difference));
}

function readOctree(side, bits, most) {
  let cells = [[0, 0, 0]];
  for (let level = 0; level < bits; level++) {
    const children = [];
    const occupancy = side.take(cells.length);
    cells.forEach(([x, y, z], i) => {
      need(occupancy[i] !== 0, "occupied cell without children");
      for (let c = 0; c < 8; c++)
        if ((occupancy[i] >> c) & 1) children.push([2 * x + (c & 1), 2 * y + ((c >> 1) & 1), 2 * z + ((c >> 2) & 1)]);
    });
    need(children.length <= most, "more cells than splats");
    cells = children;
  }
  return cells;
}

/** From differences of second order, [frames - 1][count], to values of all frames; frame 0 is zero. */
function predicted(stored, frames, count) {
  const values = [new Float64Array(count)];
  for (let t = 1; t < frames; t++) {
    const now = new Float64Array(count);
    for (let i = 0; i < count; i++)
      now[i] = stored[(t - 1) * count + i] + 2 * values[t - 1][i] - (t > 1 ? values[t - 2][i] : 0);
    values.push(now);
  }
  return values;
}

function readSide(rendition, bytes) {
  const { splats: n, frame_count: frames, positions, blocks } = rendition;
  need(wholeNumber(rendition.side.raw_bytes, 1, 2 ** 28), "wrong raw_bytes");
  const raw = inflateRawSync(bytes, { maxOutputLength: rendition.side.raw_bytes });
  need(raw.length === rendition.side.raw_bytes, "side file has another size than promised");
  const side = new Side(raw);
  const leaves = readOctree(side, positions.bits, n);
  const cells = [];
  side.numbers(leaves.length, 4).forEach((more, leaf) => {
    need(more >= 0 && cells.length + more < n, "cells hold more splats than there are");
    for (let i = 0; i <= more; i++) cells.push(leaves[leaf]);
  });
  need(cells.length === n, "cells hold fewer splats than there are");
  const runs = side.numbers(1, 4)[0];
  need(wholeNumber(runs, 1, n), "wrong number of runs");
  const lengths = side.numbers(runs, 4).map((more) => more + 1);
  const changes = side.numbers(runs, 2);
  const labels = [];
  for (let run = 0, before = [0, 0]; run < runs; run++) {
    before = [changes[run] === 0 ? before[1] : before[0] + changes[run], before[0]];
    need(before[0] >= 0 && before[0] < blocks.count, "label of no block");
    need(lengths[run] >= 1 && labels.length + lengths[run] <= n, "runs of more splats than there are");
    for (let i = 0; i < lengths[run]; i++) labels.push(before[0]);
  }
  need(labels.length === n, "runs of fewer splats than there are");
  const pairs = side.take(Math.ceil(n / 2));
  const classes = Array.from({ length: n }, (_, i) => (i % 2 === 0 ? pairs[i / 2] % 16 : pairs[(i - 1) / 2] >> 4));
  const motions = predicted(side.numbers((frames - 1) * 12 * blocks.count, 4), frames, 12 * blocks.count);
  const turns = predicted(side.numbers((frames - 1) * 3 * blocks.count, 4), frames, 3 * blocks.count);
  const count = side.numbers(1, 4)[0];
  need(count >= 0 && count <= raw.length, "wrong number of escapes");
  const channels = side.take(count);
  const escapedSplats = accumulated(side.numbers(count, 4));
  const escapedFrames = accumulated(side.numbers(count, 4));
  const codes = side.numbers(count, 4);
  need(side.at === raw.length, "side file is too long");
  const escapes = Array.from({ length: frames }, () => []);
  for (let i = 0; i < count; i++) {
    need(channels[i] < rendition.channels.length, "escape of no channel");
    need(wholeNumber(escapedSplats[i], 0, n - 1) && wholeNumber(escapedFrames[i], 0, frames - 1), "escape out of range");
    escapes[escapedFrames[i]].push([channels[i], escapedSplats[i], codes[i] < 0 ? codes[i] : 255 + codes[i]]);
  }
  return { cells, labels, classes, motions, turns, escapes };
}

function channelNames(degree) {
  const names = ["residual_x", "residual_y", "residual_z"];
  names.push("shape_xx", "shape_yy", "shape_zz", "shape_xy", "shape_xz", "shape_yz", "opacity");
  for (let k = 0; k < (degree + 1) ** 2; k++) names.push(`sh_${k}_y`, `sh_${k}_co`, `sh_${k}_cg`);
  return names;
}

/** Columns and rows of the first `count` pixels of a tile along the Morton curve. */
function mortonPixels(tile, count) {
  const pixels = [];
  for (let code = 0; pixels.length < count; code++) {
    let column = 0;
    let row = 0;
    for (let j = 0; j < 16; j++) {
      column |= ((code >>> (2 * j)) & 1) << j;
      row |= ((code >>> (2 * j + 1)) & 1) << j;
    }
    if (column < tile && row < tile) pixels.push([column, row]);
  }
  return pixels;
}

function unitFromRodrigues(x, y, z) {
  const square = x * x + y * y + z * z;
  return [(1 - square) / (1 + square), (2 * x) / (1 + square), (2 * y) / (1 + square), (2 * z) / (1 + square)];
}

function matrixOf([w, x, y, z]) {
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
    [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
    [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
  ];
}

const product = (a, b) => a.map((row) => [0, 1, 2].map((k) => row[0] * b[0][k] + row[1] * b[1][k] + row[2] * b[2][k]));

/** xx, yy, zz, xy, xz and yz of a times its transpose. */
function covariance(a) {
  const dot = (i, k) => a[i][0] * a[k][0] + a[i][1] * a[k][1] + a[i][2] * a[k][2];
  return [dot(0, 0), dot(1, 1), dot(2, 2), dot(0, 1), dot(0, 2), dot(1, 2)];
}

function* decodedFrames(source, lumaFolder, rendition) {
  const { splats: n, tile, columns, rows, positions, blocks, channels, frame_count: frames } = rendition;
  const names = channelNames(rendition.sh_degree);
  need(names.every((name, c) => channels[c]?.name === name), "wrong channels"); // others that follow are not read
  need(tile % 16 === 0 && tile * tile >= n && (tile === 16 || (tile - 16) ** 2 < n), "wrong tile", tile);
  need(columns * rows >= channels.length, "picture has too few tiles");
  const state = readSide(rendition, readFile(source, rendition.side));
  const width = columns * tile;
  const pictures = readVideo(source, lumaFolder, rendition.video, width, rows * tile, frames);
  const pixels = mortonPixels(tile, n);
  const sums = Array.from({ length: blocks.count }, () => [0, 0, 0, 0]);
  state.labels.forEach((label, i) => {
    for (let k = 0; k < 3; k++) sums[label][k] += state.cells[i][k];
    sums[label][3] += 1;
  });
  const centers = sums.map(([x, y, z, count]) => [x, y, z].map((sum) => Math.floor(sum / count)));
  const size = 10 + 3 * (rendition.sh_degree + 1) ** 2;
  for (let t = 0; t < frames; t++) {
    const codes = channels.map((_, c) => {
      const corner = Math.floor(c / columns) * tile * width + (c % columns) * tile;
      return Float64Array.from(pixels, ([column, row]) => pictures[t][corner + row * width + column]);
    });
    for (const [channel, splat, code] of state.escapes[t]) codes[channel][splat] = code;
    const values = codes.map((row, c) => row.map((code) => channels[c].offset + (code - 128) * channels[c].step));
    const frame = new Float64Array(n * size);
    for (let i = 0; i < n; i++) {
      const label = state.labels[i];
      const out = frame.subarray(i * size, (i + 1) * size);
      const u = [0, 1, 2].map((k) => ((state.cells[i][k] - centers[label][k]) * positions.step) / blocks.radius).concat(1);
      for (let k = 0; k < 3; k++) {
        out[k] = positions.min[k] + (state.cells[i][k] + 0.5) * positions.step + 2 ** state.classes[i] * values[k][i];
        for (let j = 0; j < 4; j++) out[k] += u[j] * state.motions[t][(3 * j + k) * blocks.count + label] * blocks.step;
      }
      const turn = [0, 1, 2].map((k) => state.turns[t][k * blocks.count + label] * blocks.rotation_step);
      const [xx, yy, zz, xy, xz, yz] = values.slice(3, 9).map((row) => row[i]);
      const shape = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
      out.set(covariance(product(matrixOf(unitFromRodrigues(...turn)), product(shape, shape))), 3);
      out[9] = Math.min(1, Math.max(0, values[9][i]));
      for (let c = 10; c < size; c += 3) {
        const [y, co, cg] = [values[c][i], values[c + 1][i], values[c + 2][i]];
        out.set([y + co - cg, y + cg, y - co - cg], c);
      }
    }
    yield frame;
  }
}

const [version, stream, lumaFolder, outFolder] = process.argv.slice(2);
const source = statSync(stream).isDirectory() ? folderSource(stream) : archiveSource(stream);
const manifest = readManifest(source);
const groups = allGroups(source, manifest);
checkRest(source, manifest, groups);
const sets = manifest.set.map((part) => ({ first_frame: `set${part.index}`, only: [{ ...part, id: "set" }] }));
for (const group of [...groups, ...sets]) {
  for (const rendition of group.only ?? renditionsOf(manifest, group)) {
    need(wholeNumber(rendition.splats, 1, 4194304), "wrong number of splats");
    need(wholeNumber(rendition.sh_degree, 0, 3), "wrong SH degree");
    let t = group.first_frame;
    for (const frame of decodedFrames(source, lumaFolder, rendition)) {
      const file = join(outFolder, `${rendition.id}_${t}.f64`);
      writeFileSync(file, frame);
      const { id, splats, sh_degree } = rendition;
      console.log(JSON.stringify({ rendition: id, frame: t, splats, sh_degree, file }));
      t += 1;
    }
  }
}
