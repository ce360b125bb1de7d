/** The elements of the controls. */

import { helpLines } from "./actions.ts";
import { type BackgroundName, BACKGROUNDS, SPEEDS } from "./choices.ts";
import { helpRow } from "./format.ts";
import { canShare } from "./give_link.ts";
import * as ICONS from "./icons.ts";
import type { Words } from "./words.ts";

export const button = (act: string, label: string, icon: string, more = ""): string =>
  `<button type="button" data-act="${act}" aria-label="${label}" title="${label}" ${more}>${icon}</button>`;

/** A group of radio buttons. `more`: attributes of what is seen. */
const radios = (name: string, title: string, choices: readonly [value: string, label: string, more: string][]): string => `<div>
  <h3 id="${name}">${title}</h3>
  <div class="choices" role="radiogroup" aria-labelledby="${name}">${choices.map(([value, label, more]) =>
    `<label title="${label}"><input type="radio" name="${name}" value="${value}"><span ${more}>${label}</span></label>`).join("")}</div>
</div>`;

/** The heading of a sheet, with its close button. */
const heading = (title: string, words: Words): string =>
  `<h2>${title} <button type="button" class="close" data-act="close" aria-label="${words.close}" title="${words.close}">${ICONS.close}</button></h2>`;

/** The buttons of VR and AR, which are shown where the device has them. */
const immersions = (words: Words, more: string): string =>
  button("vr", words.vr, "VR", more) + button("ar", words.ar, "AR", more);

/** The hint and the bar. `buttons`: those after the time. */
export const barTemplate = (words: Words, buttons: string): string => `
<div class="hint" role="status" aria-live="polite">${ICONS.turn}<span><b></b> <small></small></span></div>
<div class="bar" part="controls">
  <div class="timeline" role="slider" tabindex="0" aria-label="${words.time}" aria-valuemin="0" aria-valuemax="0" aria-valuenow="0"></div>
  <div class="buttons">
    ${button("play", words.play, ICONS.play)}
    <div class="time"><b class="now">0:00.0</b> <span class="total"></span></div>
    ${buttons}
  </div>
</div>`;

export const template = (words: Words): string => `
<p class="unseen" id="keys">${words.keys}</p>
<p class="unseen spoken" role="status" aria-live="polite"></p>
<div class="top">
  <header class="head" hidden><h1 class="title"></h1><p class="credits"></p></header>
  <div class="notice" role="status" aria-live="polite"></div>
  <div class="update" role="alert" hidden>${words.updated} <button type="button" class="plain" data-act="update">${words.showUpdated}</button></div>
  <div class="caption" role="status" hidden><span></span> <span></span> <button type="button" class="plain" data-act="note">${words.next}</button></div>
</div>
${barTemplate(words, `
    ${button("sound", words.soundOff, ICONS.sound, "hidden")}
    <div class="gap"></div>
    ${button("reset", words.reset, ICONS.reset)}
    ${button("link", words.share, canShare() ? ICONS.share : ICONS.link, "hidden")}
    ${immersions(words, 'class="wide" hidden')}
    ${button("info", words.statistics, ICONS.info, 'class="wide" aria-pressed="false"')}
    ${button("settings", words.settings, ICONS.settings, 'aria-expanded="false"')}
    ${button("full", words.full, ICONS.full)}`)}
<div class="sheet settings" role="dialog" aria-label="${words.settings}" tabindex="-1" hidden>
  ${heading(words.settings, words)}
  <div class="groups">
    ${radios("speed", words.speed, SPEEDS.map((speed) => [`${speed}`, `${speed}×`, ""]))}
    ${radios("loop", words.atEnd, [["true", words.loop, ""], ["false", words.stop, ""]])}
    ${radios("background", words.background, Object.keys(BACKGROUNDS).map((name) => [name, words.backgrounds[name as BackgroundName], `class="swatch ${name}"`]))}
    <div>
      <h3>${words.more}</h3>
      <div class="choices">
        <button type="button" data-act="info">${words.statistics}</button>
        ${immersions(words, "hidden")}
        <button type="button" data-act="help">${words.help}</button>
      </div>
    </div>
  </div>
</div>
<div class="sheet help" role="dialog" aria-label="${words.help}" tabindex="-1" hidden>
  ${heading(words.help, words)}
  <table><tbody>${helpLines(words).map(helpRow).join("")}</tbody></table>
</div>
<section class="sheet info" aria-label="${words.statistics}" tabindex="-1" hidden>
  ${heading(words.statistics, words)}
  <table><tbody></tbody></table>
</section>
<div class="sheet copy" role="dialog" aria-label="${words.link}" tabindex="-1" hidden>
  ${heading(words.linkTo, words)}
  <input class="address" readonly aria-label="${words.link}">
  <p>${words.copyYourself}</p>
</div>
<div class="sheet which" role="dialog" aria-label="${words.whichLink}" tabindex="-1" hidden>
  ${heading(words.linkTo, words)}
  <button type="button" class="offer" data-act="link-watch"><b>${words.toWatch}</b><small>${words.toWatchMore}</small></button>
  <button type="button" class="offer" data-act="link-review"><b>${words.toReview}</b><small>${words.toReviewMore}</small></button>
</div>
`;
