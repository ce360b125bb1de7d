/** The worker's bundle as text, inserted by build.mjs. */
declare module "worker-source" {
  const source: string;
  export default source;
}

/** Definitions of docs/stream.schema.json, inserted by schema.mjs. */
declare module "stream-schema" {
  const definitions: Readonly<Record<string, import("./stream/json_schema.ts").Schema>>;
  export default definitions;
}

/** The text of a style sheet, inserted by build.mjs. */
declare module "*.css" {
  const text: string;
  export default text;
}
