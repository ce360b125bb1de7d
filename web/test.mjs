// Runs the unit tests with Node's own test runner: bundled first, since Node takes no TypeScript of every kind.
import { build } from "esbuild";
import { spawnSync } from "node:child_process";
import { readdirSync } from "node:fs";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { schemaPlugin } from "./schema.mjs";

const here = dirname(fileURLToPath(import.meta.url));
const out = join(here, "tests", "build");
const tests = readdirSync(join(here, "tests")).filter((name) => name.endsWith(".test.ts"));
await build({
  absWorkingDir: here,
  entryPoints: tests.map((name) => join("tests", name)),
  outdir: out,
  outExtension: { ".js": ".mjs" },
  bundle: true,
  platform: "node",
  format: "esm",
  plugins: [schemaPlugin],
  logLevel: "warning",
});
const files = tests.map((name) => join(out, name.replace(/\.ts$/, ".mjs")));
const run = spawnSync(process.execPath, ["--test", ...files], {
  stdio: "inherit",
  env: { V3_FIXTURES: join(out, "fixtures"), ...process.env },
});
process.exit(run.status ?? 1);
