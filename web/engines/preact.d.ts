/** Types of `<v3-player>` in Preact: `import type {} from "@v3studio/player/preact"`. */
import type { HTMLAttributes as Attributes } from "preact";
import type { V3PlayerElement, V3PlayerHandlers, V3PlayerProperties } from "../src/main.ts";

type Own = Partial<V3PlayerProperties> & V3PlayerHandlers;

declare module "preact" {
  namespace JSX {
    interface IntrinsicElements {
      "v3-player": Omit<Attributes<V3PlayerElement>, keyof Own> & Own;
    }
  }
}
