/** The elements of a player before its controls are loaded. */

import { FIRST_WORDS, type Language } from "./first_words.ts";
import * as ICONS from "./icons.ts";

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
