// What the player's page and the package have in common: esbuild's options, and the worker's source as a module.
import { build, transform } from "esbuild";
import { readFile } from "node:fs/promises";
import { dirname } from "node:path";
import { fileURLToPath } from "node:url";
import { schemaPlugin } from "./schema.mjs";

export const here = dirname(fileURLToPath(import.meta.url));

export const common = {
  absWorkingDir: here,
  bundle: true,
  minify: true,
  target: ["es2022", "chrome107", "firefox113", "safari16.4"],
  legalComments: "none",
  banner: { js: "/*! Copyright (c) 2026 The V3 Studio authors. SPDX-License-Identifier: MIT */" },
  logLevel: "warning",
};

/** Style sheets as text, without what only people read. */
export const styles = {
  name: "styles",
  setup(builder) {
    builder.onLoad({ filter: /\.css$/ }, async ({ path }) => {
      const { code } = await transform(await readFile(path, "utf8"), { loader: "css", minify: true, target: common.target });
      return { contents: code.trim(), loader: "text" };
    });
  },
};

const worker = await build({ ...common, banner: {}, plugins: [schemaPlugin], entryPoints: ["src/worker/main.ts"], format: "iife", write: false });
export const workerText = worker.outputFiles[0].text;

/** Plugins for whatever starts the worker. */
export const plugins = [
  schemaPlugin,
  styles,
  {
    name: "worker-source",
    setup(builder) {
      builder.onResolve({ filter: /^worker-source$/ }, () => ({ path: "worker-source", namespace: "worker" }));
      builder.onLoad({ filter: /.*/, namespace: "worker" }, () => ({ contents: workerText, loader: "text" }));
    },
  },
];
