/** Icons, 24 x 24, in the text color. Each is an export of its own: the first image needs few. */

/* @__NO_SIDE_EFFECTS__ */
const icon = (body: string): string =>
  `<svg viewBox="0 0 24 24" width="22" height="22" fill="none" stroke="currentColor" stroke-width="1.7" stroke-linecap="round" stroke-linejoin="round" aria-hidden="true">${body}</svg>`;

export const play = icon('<path d="M8 5.2v13.6a.6.6 0 0 0 .92.5l10.4-6.8a.6.6 0 0 0 0-1L8.92 4.7A.6.6 0 0 0 8 5.2Z" fill="currentColor" stroke="none"/>');
export const pause = icon('<path d="M8.2 5.5v13M15.8 5.5v13" stroke-width="3"/>');
export const reset = icon('<path d="M4.5 12a7.5 7.5 0 1 0 2.4-5.5"/><path d="M4.2 4.6v3.9h3.9"/>');
export const settings = icon('<path d="M4 7h9M17 7h3M4 17h3M11 17h9"/><circle cx="15" cy="7" r="2"/><circle cx="9" cy="17" r="2"/>');
export const info = icon('<path d="M4.5 19V11M10 19V5M15.5 19v-6M20.5 19V8"/>');
export const link = icon('<path d="M10 14a4 4 0 0 0 5.7 0l3.1-3.1a4 4 0 0 0-5.7-5.7L12 6.3"/><path d="M14 10a4 4 0 0 0-5.7 0l-3.1 3.1a4 4 0 0 0 5.7 5.7l1.1-1.1"/>');
export const share = icon('<path d="M12 14.5V4M8.4 7.2 12 3.6l3.6 3.6"/><path d="M8 10.5H6v9h12v-9h-2"/>');
export const sound = icon('<path d="M4.5 9.8v4.4h3l4.3 3.6V6.2L7.5 9.8h-3Z"/><path d="M15.2 9.3a4 4 0 0 1 0 5.4M17.8 6.7a7.6 7.6 0 0 1 0 10.6"/>');
export const silent = icon('<path d="M4.5 9.8v4.4h3l4.3 3.6V6.2L7.5 9.8h-3Z"/><path d="m15.5 9.8 4.4 4.4M19.9 9.8l-4.4 4.4"/>');
export const full = icon('<path d="M4.5 9V4.5H9M15 4.5h4.5V9M19.5 15v4.5H15M9 19.5H4.5V15"/>');
export const small = icon('<path d="M9 4.5V9H4.5M19.5 9H15V4.5M15 19.5V15h4.5M4.5 15H9v4.5"/>');
export const turn = icon('<path d="M12 8.2c5 0 9 1.5 9 3.6s-4 3.6-9 3.6-9-1.5-9-3.6c0-1 .9-1.9 2.4-2.5"/><path d="m9.6 12.6 2.6 2.8-2.6 2.8"/>');
export const close = icon('<path d="m6.5 6.5 11 11M17.5 6.5l-11 11"/>');
