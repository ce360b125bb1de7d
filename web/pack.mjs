// Builds the npm package @v3studio/player into a folder, from which `npm pack` makes an archive.
//
// node pack.mjs FOLDER
import { build } from "esbuild";
import { spawnSync } from "node:child_process";
import { copyFile, mkdir, readdir, readFile, rm, writeFile } from "node:fs/promises";
import { join, resolve } from "node:path";
import { gzipSync } from "node:zlib";
import { common, here, plugins } from "./bundle.mjs";

const out = resolve(process.argv[2]);
const ADAPTER_LIMIT = 6_000;
const ENTRIES = { player: "src/main.ts", stream: "src/package.ts", three: "engines/three.ts", playcanvas: "engines/playcanvas.ts" };
const JSX = ["react", "preact"];
const ENGINES = { three: "^0.187.0", "@sparkjsdev/spark": "^2.2.0", playcanvas: "^2.23.3" };

await rm(out, { recursive: true, force: true });
await mkdir(out, { recursive: true });
// What several entries need is in a file of its own, so that a page that imports two of them loads it once.
await build({
  ...common,
  plugins,
  entryPoints: ENTRIES,
  external: Object.keys(ENGINES),
  format: "esm",
  splitting: true,
  chunkNames: "shared-[hash]",
  outdir: out,
});

const types = join(out, "types");
const tsc = join(here, "node_modules", "typescript", "bin", "tsc");
const options = ["--noEmit", "false", "--emitDeclarationOnly", "--declaration", "--stripInternal", "--rootDir", here, "--outDir", types];
const emitted = spawnSync(process.execPath, [tsc, "-p", join(here, "engines"), ...options], { stdio: "inherit" });
if (emitted.status !== 0) process.exit(emitted.status ?? 1);
for (const name of await readdir(types, { recursive: true })) {
  if (!name.endsWith(".d.ts")) continue;
  const text = await readFile(join(types, name), "utf8");
  await writeFile(join(types, name), text.replace(/(["'])(\.{1,2}\/[^"']*)\.ts\1/g, "$1$2.js$1"));
}

for (const name of JSX) {
  const text = await readFile(join(here, "engines", `${name}.d.ts`), "utf8");
  await writeFile(join(types, "engines", `${name}.d.ts`), text.replace("main.ts", "main.js"));
}

const { version, license, description } = JSON.parse(await readFile(join(here, "package.json"), "utf8"));
const entry = (name) => ({ types: `./types/${ENTRIES[name].replace(/\.ts$/, ".d.ts")}`, default: `./${name}.js` });
const jsx = Object.fromEntries(JSX.map((name) => [`./${name}`, { types: `./types/engines/${name}.d.ts` }]));
const manifest = {
  name: "@v3studio/player",
  version,
  description,
  license,
  type: "module",
  sideEffects: ["./player.js"],
  exports: { ".": entry("player"), "./stream": entry("stream"), "./three": entry("three"), "./playcanvas": entry("playcanvas"), ...jsx },
  files: ["*.js", "types"],
  peerDependencies: ENGINES,
  peerDependenciesMeta: Object.fromEntries(Object.keys(ENGINES).map((name) => [name, { optional: true }])),
};
await writeFile(join(out, "package.json"), `${JSON.stringify(manifest, null, 2)}\n`);
await copyFile(join(here, "README.md"), join(out, "README.md"));
await copyFile(join(here, "LICENSE"), join(out, "LICENSE"));

for (const name of ["three", "playcanvas"]) {
  const size = gzipSync(await readFile(join(out, `${name}.js`)), { level: 9 }).length;
  console.log(`${name}.js: ${size} bytes gzipped`);
  if (size > ADAPTER_LIMIT) {
    console.error(`${name}.js is larger than ${ADAPTER_LIMIT} bytes gzipped.`);
    process.exit(1);
  }
}
