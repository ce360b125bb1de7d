// Builds the player into ../v3studio/player: the page, one script with the worker inside, the same in two parts, of which the
// first shows an image and then fetches the rest, and scripts that only pages for reviews and for casts load.
import { build } from "esbuild";
import { createHash } from "node:crypto";
import { mkdir, readdir, readFile, rm, writeFile } from "node:fs/promises";
import { join } from "node:path";
import { gzipSync } from "node:zlib";
import { common, here, plugins, styles, workerText } from "./bundle.mjs";

const out = process.argv[2] ?? join(here, "..", "v3studio", "player");
const LIMIT = 95_000;
const FIRST_LIMIT = 50_000;
const REVIEW_LIMIT = 20_000;

const player = await build({ ...common, plugins, entryPoints: ["src/main.ts"], format: "esm", write: false });
const review = await build({ ...common, plugins: [styles], entryPoints: ["src/review/main.ts"], format: "esm", write: false });

const cast = await build({ ...common, plugins, entryPoints: ["src/cast/main.ts"], format: "esm", write: false });

const rest = (await build({ ...common, plugins, entryPoints: ["src/ui/rest.ts"], format: "esm", write: false })).outputFiles[0].text;
const restName = `v3-rest-${createHash("sha256").update(rest).digest("hex").slice(0, 10)}.js`;
const apart = {
  name: "apart",
  setup(builder) {
    builder.onResolve({ filter: /\/(rest|sound|video_reader)\.ts$/ }, ({ kind }) =>
      kind === "dynamic-import" ? { path: `./${restName}`, external: true } : undefined);
  },
};
const first = (await build({ ...common, plugins: [apart, ...plugins], entryPoints: ["src/main.ts"], format: "esm", write: false }))
  .outputFiles[0].text;

await mkdir(out, { recursive: true });
for (const name of await readdir(out)) if (name.startsWith("v3-rest-")) await rm(join(out, name));
await writeFile(join(out, "v3-first.js"), first);
await writeFile(join(out, restName), rest);
const script = player.outputFiles[0].text;
const page = await readFile(join(here, "src", "index.html"), "utf8");
await writeFile(join(out, "v3-player.js"), script);
await writeFile(join(out, "v3-review.js"), review.outputFiles[0].text);
await writeFile(join(out, "v3-cast.js"), cast.outputFiles[0].text);
await writeFile(join(out, "index.html"), page);

const size = gzipSync(script, { level: 9 }).length + gzipSync(page, { level: 9 }).length;
const workerSize = gzipSync(workerText, { level: 9 }).length;
console.log(`player: ${script.length + page.length} bytes, ${size} gzipped (the worker ${workerSize})`);
const firstSize = gzipSync(first, { level: 9 }).length;
console.log(`for the first image: ${first.length} bytes, ${firstSize} gzipped; the rest ${gzipSync(rest, { level: 9 }).length}`);
const reviewSize = gzipSync(review.outputFiles[0].text, { level: 9 }).length;
console.log(`review: ${reviewSize} bytes gzipped; cast: ${gzipSync(cast.outputFiles[0].text, { level: 9 }).length}`);
if (size > LIMIT || firstSize > FIRST_LIMIT || reviewSize > REVIEW_LIMIT) {
  console.error(`Gzipped, the player is larger than ${LIMIT} bytes, its first part than ${FIRST_LIMIT}, or the review than ${REVIEW_LIMIT}.`);
  process.exit(1);
}
