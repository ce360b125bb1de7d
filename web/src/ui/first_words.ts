/** The words and the elements of a player before its controls are loaded, and the choice of the language. */

import * as ICONS from "./icons.ts";

export const FIRST_WORDS = {
  en: { kind: "3D video", video: "Volumetric video", loading: "Loading", again: "Try again", play: "Play" },
  de: { kind: "3D-Video", video: "Volumetrisches Video", loading: "Wird geladen", again: "Erneut versuchen", play: "Abspielen" },
  ja: { kind: "3D動画", video: "ボリュメトリックビデオ", loading: "読み込み中", again: "再試行", play: "再生" },
};

export type Language = keyof typeof FIRST_WORDS;

/** The language of a player's controls: the element's attribute `lang`; in the middle of a page, the page's; else the first of
 * the browser's that there is, or English. */
export function languageOf(element: HTMLElement): Language {
  const page = element.hasAttribute("page") ? null : element.closest("[lang]");
  const asked = [element.lang, page?.getAttribute("lang") ?? "", ...navigator.languages];
  const known = (tag: string): tag is Language => Object.hasOwn(FIRST_WORDS, tag);
  return asked.map((tag) => tag.toLowerCase().split("-")[0]).find(known) ?? "en";
}

/** Says in which language the elements of a player are. */
export function setLanguage(root: ShadowRoot, language: Language): void {
  for (const part of root.children) if (part instanceof HTMLElement) part.lang = language;
}

/** The elements of a player before its controls are loaded. */
export function firstTemplate(language: Language): string {
  const { kind, video, play, loading, again } = FIRST_WORDS[language];
  return `
<div class="stage" tabindex="0" role="application" aria-roledescription="${kind}" aria-label="${video}" aria-describedby="about keys">
  <canvas></canvas>
  <button type="button" class="start" data-act="start" aria-label="${play}" hidden>${ICONS.play}</button>
</div>
<p class="unseen" id="about"></p>
<div class="poster"><slot><img alt="" hidden></slot></div>
<div class="veil"><div class="spinner" role="status" aria-label="${loading}"></div></div>
<div class="failure" role="alert" hidden><div><p class="why"></p><p><button type="button" class="plain" data-act="again">${again}</button></p></div></div>`;
}
