// Builds the player into ../v3studio/player: the page, one script with the worker inside, a second script that only pages
// for reviews load.
import { build } from "esbuild";
import { mkdir, readFile, writeFile } from "node:fs/promises";
import { join } from "node:path";
import { gzipSync } from "node:zlib";
import { common, here, plugins, styles, workerText } from "./bundle.mjs";

const out = process.argv[2] ?? join(here, "..", "v3studio", "player");
const LIMIT = 95_000;
const REVIEW_LIMIT = 20_000;

const player = await build({ ...common, plugins, entryPoints: ["src/main.ts"], format: "esm", write: false });
const review = await build({ ...common, plugins: [styles], entryPoints: ["src/review/main.ts"], format: "esm", write: false });

await mkdir(out, { recursive: true });
const script = player.outputFiles[0].text;
const page = await readFile(join(here, "src", "index.html"), "utf8");
await writeFile(join(out, "v3-player.js"), script);
await writeFile(join(out, "v3-review.js"), review.outputFiles[0].text);
await writeFile(join(out, "index.html"), page);

const size = gzipSync(script, { level: 9 }).length + gzipSync(page, { level: 9 }).length;
const workerSize = gzipSync(workerText, { level: 9 }).length;
console.log(`player: ${script.length + page.length} bytes, ${size} gzipped (the worker ${workerSize})`);
const reviewSize = gzipSync(review.outputFiles[0].text, { level: 9 }).length;
console.log(`review: ${reviewSize} bytes gzipped`);
if (size > LIMIT || reviewSize > REVIEW_LIMIT) {
  console.error(`The player is larger than ${LIMIT} bytes gzipped, or the review than ${REVIEW_LIMIT}.`);
  process.exit(1);
}
