/** The worker's bundle as text, inserted by build.mjs. */
declare module "worker-source" {
  const source: string;
  export default source;
}

/** Definitions, and names of channels, of docs/stream.schema.json, inserted by schema.mjs. */
declare module "stream-schema" {
  export const definitions: import("./stream/json_schema.ts").Definitions;
  export const names: Readonly<Record<string, readonly string[]>>;
}

/** The text of a style sheet, inserted by build.mjs. */
declare module "*.css" {
  const text: string;
  export default text;
}
