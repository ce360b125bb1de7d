/** The worker's bundle as text, inserted by build.mjs. */
declare module "worker-source" {
  const source: string;
  export default source;
}

/** The text of a style sheet, inserted by build.mjs. */
declare module "*.css" {
  const text: string;
  export default text;
}
