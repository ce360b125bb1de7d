/** Types of `<v3-player>` in React 19: `import type {} from "@v3studio/player/react"`. */
import type { DetailedHTMLProps, HTMLAttributes } from "react";
import type { V3PlayerElement, V3PlayerHandlers, V3PlayerProperties } from "../src/main.ts";

type Own = Partial<V3PlayerProperties> & V3PlayerHandlers;

declare module "react" {
  namespace JSX {
    interface IntrinsicElements {
      "v3-player": Omit<DetailedHTMLProps<HTMLAttributes<V3PlayerElement>, V3PlayerElement>, keyof Own> & Own;
    }
  }
}
