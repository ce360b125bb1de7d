// Bundles a page's script for each framework: node build.mjs FOLDER. `show(properties)` of the page renders `<v3-player>` with
// them, `show(null)` nothing; `told` has the frames of its events.
import { mkdir, writeFile } from "node:fs/promises";
import { createRequire } from "node:module";
import { dirname, join } from "node:path";
import { fileURLToPath, pathToFileURL } from "node:url";

const web = join(dirname(fileURLToPath(import.meta.url)), "..", "..", "..", "web");
const { build } = createRequire(join(web, "package.json"))("esbuild");
const { compile, compileModule } = await import(pathToFileURL(join(web, "engines", "node_modules", "svelte", "src", "compiler", "index.js")).href);
const NAMES = ["src", "poster", "preload", "background", "view", "intro", "decoder", "autoplay", "loop", "muted", "controls", "page", "allowSrc"];

const PAGES = {
  react: `import { createElement } from "react";
import { createRoot } from "react-dom/client";
const root = createRoot(place);
window.show = (values) => root.render(values && createElement("v3-player", { ...values, "onv3-time": tell }));`,
  preact: `import { h, render } from "preact";
window.show = (values) => render(values && h("v3-player", { ...values, "onv3-time": tell }), place);`,
  vue: `import { createApp, h, shallowRef } from "vue";
const shown = shallowRef(null);
createApp({ render: () => shown.value && h("v3-player", { ...shown.value, "on:v3-time": tell }) }).mount(place);
window.show = (values) => { shown.value = values; };`,
  svelte: `import { mount } from "svelte";
import App from "./app.svelte";
import { shown } from "./shown.svelte.js";
mount(App, { target: place });
window.show = (values) => { shown.values = values; };`,
  lit: `import { html, nothing, render } from "lit";
window.show = (values) => render(values === null ? nothing : html\`<v3-player ${NAMES.map((name) => `.${name}=\${values.${name}}`).join(" ")} @v3-time=\${tell}></v3-player>\`, place);`,
};
const SVELTE = {
  "app.svelte": `<script>
  import { shown } from "./shown.svelte.js";
</script>
{#if shown.values}<v3-player {...shown.values} onv3-time={(event) => tell(event)}></v3-player>{/if}`,
  "shown.svelte.js": "export const shown = $state({ values: null });",
};
const svelte = {
  name: "svelte",
  setup(builder) {
    builder.onResolve({ filter: /^\.\/.*\.svelte/ }, ({ path }) => ({ path: path.slice(2), namespace: "svelte" }));
    builder.onLoad({ filter: /.*/, namespace: "svelte" }, ({ path: filename }) => {
      const made = filename.endsWith(".js") ? compileModule(SVELTE[filename], { filename }) : compile(SVELTE[filename], { filename, generate: "client" });
      return { contents: made.js.code, resolveDir: web };
    });
  },
};

const out = process.argv[2];
await mkdir(out, { recursive: true });
for (const [name, script] of Object.entries(PAGES)) {
  await build({
    stdin: { contents: script, resolveDir: web },
    bundle: true,
    format: "esm",
    outfile: join(out, `${name}.js`),
    nodePaths: [join(web, "engines", "node_modules")],
    conditions: ["browser", "production"],
    define: { "process.env.NODE_ENV": '"production"', __VUE_OPTIONS_API__: "false", __VUE_PROD_DEVTOOLS__: "false", __VUE_PROD_HYDRATION_MISMATCH_DETAILS__: "false" },
    plugins: [svelte],
    logLevel: "error",
  });
  await writeFile(join(out, `${name}.html`), `<!doctype html><div id="place"></div><script>
window.told = [];
const tell = ({ detail }) => told.push(detail.frame);
</script><script type="module">import "./v3-player.js"; import "./${name}.js";</script>`);
}
