// Builds the player into ../v3studio/player: the page, one script with the worker inside, a second script that only pages
// for reviews load.
import { build, transform } from "esbuild";
import { mkdir, readFile, rm, writeFile } from "node:fs/promises";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { gzipSync } from "node:zlib";
import { schemaPlugin } from "./schema.mjs";

const here = dirname(fileURLToPath(import.meta.url));
const out = process.argv[2] ?? join(here, "..", "v3studio", "player");
const LIMIT = 95_000;
const REVIEW_LIMIT = 20_000;

const common = {
  absWorkingDir: here,
  bundle: true,
  minify: true,
  target: ["es2022", "chrome107", "firefox113", "safari16.4"],
  legalComments: "none",
  logLevel: "warning",
};

/** Style sheets as text, without what only people read. */
const styles = {
  name: "styles",
  setup(builder) {
    builder.onLoad({ filter: /\.css$/ }, async ({ path }) => {
      const { code } = await transform(await readFile(path, "utf8"), { loader: "css", minify: true, target: common.target });
      return { contents: code.trim(), loader: "text" };
    });
  },
};

const worker = await build({ ...common, plugins: [schemaPlugin], entryPoints: ["src/worker/main.ts"], format: "iife", write: false });
const workerText = worker.outputFiles[0].text;

const player = await build({
  ...common,
  entryPoints: ["src/main.ts"],
  format: "esm",
  write: false,
  plugins: [
    schemaPlugin,
    styles,
    {
      name: "worker-source",
      setup(builder) {
        builder.onResolve({ filter: /^worker-source$/ }, () => ({ path: "worker-source", namespace: "worker" }));
        builder.onLoad({ filter: /.*/, namespace: "worker" }, () => ({ contents: workerText, loader: "text" }));
      },
    },
  ],
});

const review = await build({ ...common, plugins: [styles], entryPoints: ["src/review/main.ts"], format: "esm", write: false });

await rm(out, { recursive: true, force: true });
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
