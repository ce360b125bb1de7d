/** The elements of the controls. */

import { HELP, type HelpLine } from "./actions.ts";
import { BACKGROUNDS, SPEEDS } from "./choices.ts";
import { ICONS } from "./icons.ts";
import { canShare } from "./give_link.ts";

const button = (act: string, label: string, icon: string, more = ""): string =>
  `<button type="button" data-act="${act}" aria-label="${label}" title="${label}" ${more}>${icon}</button>`;

/** A group of radio buttons. `more`: attributes of what is seen. */
const radios = (name: string, title: string, choices: readonly [value: string, label: string, more: string][]): string => `<div>
  <h3 id="${name}">${title}</h3>
  <div class="choices" role="radiogroup" aria-labelledby="${name}">${choices.map(([value, label, more]) =>
    `<label title="${label}"><input type="radio" name="${name}" value="${value}"><span ${more}>${label}</span></label>`).join("")}</div>
</div>`;

const swatch = (name: string, { label }: { label: string }): [string, string, string] =>
  [name, label, `class="swatch ${name}"`];

export const helpRow = ({ what, touch, keys }: HelpLine): string => {
  const only = touch === undefined ? "keys" : keys === undefined ? "touch" : "";
  const cells = [touch && `<span class="touch">${touch}</span>`, keys && `<span class="keys">${keys}</span>`].join("");
  return `<tr class="${only}"><th scope="row">${what}</th><td>${cells}</td></tr>`;
};

/** Of a sheet. */
const heading = (title: string): string =>
  `<h2>${title} <button type="button" class="close" data-act="close" aria-label="Close" title="Close">${ICONS.close}</button></h2>`;

/** Shown where the device has them. */
const immersions = (more: string): string =>
  button("vr", "Watch in VR", "VR", more) + button("ar", "Place in the room (AR)", "AR", more);

export const template = (): string => `
<p class="unseen" id="keys">Arrow keys turn, Shift and arrow keys move, plus and minus zoom, R resets the view, Space plays and pauses. Question mark: all keys.</p>
<p class="unseen spoken" role="status" aria-live="polite"></p>
<div class="top">
  <header class="head" hidden><h1 class="title"></h1><p class="credits"></p></header>
  <div class="notice" role="status" aria-live="polite"></div>
  <div class="update" role="alert" hidden>This take was updated. <button type="button" class="plain" data-act="update">Show the new version</button></div>
</div>
<div class="hint" role="status" aria-live="polite">${ICONS.turn}<span><b></b> <small></small></span></div>
<div class="bar" part="controls">
  <div class="timeline" role="slider" tabindex="0" aria-label="Time" aria-valuemin="0" aria-valuemax="0" aria-valuenow="0"></div>
  <div class="buttons">
    ${button("play", "Play", ICONS.play)}
    <div class="time"><b class="now">0:00.0</b> <span class="total"></span></div>
    ${button("sound", "Turn sound off", ICONS.sound, "hidden")}
    <div class="gap"></div>
    ${button("reset", "Reset view", ICONS.reset)}
    ${button("link", "Share", canShare() ? ICONS.share : ICONS.link, "hidden")}
    ${immersions('class="wide" hidden')}
    ${button("info", "Statistics", ICONS.info, 'class="wide" aria-pressed="false"')}
    ${button("settings", "Settings", ICONS.settings, 'aria-expanded="false"')}
    ${button("full", "Full screen", ICONS.full)}
  </div>
</div>
<div class="sheet settings" role="dialog" aria-label="Settings" tabindex="-1" hidden>
  ${heading("Settings")}
  <div class="groups">
    ${radios("speed", "Speed", SPEEDS.map((speed) => [`${speed}`, `${speed}×`, ""]))}
    ${radios("loop", "At the end", [["true", "Loop", ""], ["false", "Stop", ""]])}
    ${radios("background", "Background", Object.entries(BACKGROUNDS).map((one) => swatch(...one)))}
    <div>
      <h3>More</h3>
      <div class="choices">
        <button type="button" data-act="info">Statistics</button>
        ${immersions("hidden")}
        <button type="button" data-act="help">Help</button>
      </div>
    </div>
  </div>
</div>
<div class="sheet help" role="dialog" aria-label="Help" tabindex="-1" hidden>
  ${heading("Help")}
  <table><tbody>${HELP.map(helpRow).join("")}</tbody></table>
</div>
<section class="sheet info" aria-label="Statistics" tabindex="-1" hidden>
  ${heading("Statistics")}
  <table><tbody></tbody></table>
</section>
<div class="sheet copy" role="dialog" aria-label="Link" tabindex="-1" hidden>
  ${heading("Link to this time and view")}
  <input class="address" readonly aria-label="Link">
  <p>This browser does not let the page copy: copy the selected link yourself.</p>
</div>
<div class="sheet which" role="dialog" aria-label="Which link" tabindex="-1" hidden>
  ${heading("Link to this time and view")}
  <button type="button" class="offer" data-act="link-watch"><b>Share link to watch</b><small>The player alone, without the review.</small></button>
  <button type="button" class="offer" data-act="link-review"><b>Share link to this review</b><small>Secret: anyone who has it sees the footage and can change marks.</small></button>
</div>
`;
