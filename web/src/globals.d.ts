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

/** Flags of WebGPU, which TypeScript's library declares as plain numbers without their names. */
declare const GPUBufferUsage: Readonly<
  Record<"MAP_READ" | "COPY_SRC" | "COPY_DST" | "INDEX" | "UNIFORM" | "STORAGE" | "INDIRECT" | "QUERY_RESOLVE", number>
>;
declare const GPUTextureUsage: Readonly<Record<"COPY_SRC" | "COPY_DST" | "TEXTURE_BINDING" | "RENDER_ATTACHMENT", number>>;
declare const GPUShaderStage: Readonly<Record<"VERTEX" | "FRAGMENT" | "COMPUTE", number>>;
declare const GPUMapMode: Readonly<Record<"READ", number>>;
