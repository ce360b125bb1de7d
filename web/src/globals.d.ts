/** The worker's bundle as text, put in by build.mjs. */
declare module "worker-source" {
  const source: string;
  export default source;
}

/** A style sheet's text, put in by build.mjs. */
declare module "*.css" {
  const text: string;
  export default text;
}
