/** The controls' behavior: playback, sheets, sound, full screen, VR and AR. */

import type { Player } from "../player/player.ts";
import { messageOf } from "../stream/errors.ts";
import type { Vector } from "../stream/metadata.ts";
import type { StreamInfo } from "../worker/messages.ts";
import { hasImmersion, type Immersion, Immersive } from "../xr/immersive.ts";
import { Bar } from "./bar.ts";
import { type BackgroundName, BACKGROUNDS, cssColor, isBackground, isSuggested, SPEEDS } from "./choices.ts";
import { clock, type HelpLine, helpRow } from "./format.ts";
import { copyText, shareLink } from "./give_link.ts";
import { Hint } from "./hint.ts";
import * as ICONS from "./icons.ts";
import { linkTo } from "./link.ts";
import { Motion } from "./motion.ts";
import { showFigures } from "./panel.ts";
import { type SheetName, Sheets } from "./sheets.ts";
import { Thumbnails } from "./thumbnails.ts";
import { Timeline } from "./timeline.ts";

const FAINTEST = 0.1; // opacity of the image where nothing was filmed

/** The element to which the controls belong. */
export interface ControlsHost extends HTMLElement {
  readonly state: { readonly ready: boolean; readonly loop: boolean };
  readonly background: string;
  play(): void;
  pause(): void;
  seek(seconds: number): void;
  /** Opens its stream, or a stream in one file. */
  open(file?: File): void;
  setSpeed(speed: number): void;
  setLoop(loop: boolean): void;
  setMuted(muted: boolean): void;
  setBackground(name: BackgroundName): void;
  openUpdated(): void;
  endIntro(): void;
}

export class Controls extends Bar<ControlsHost> {
  readonly motion: Motion;
  readonly timeline: Timeline;
  readonly sheets: Sheets;
  /** The session in a headset or on the camera's image; null if there is none. */
  immersive: Immersive | null = null;
  /** Further URL parameters of links to a review. */
  reviewParameters: () => Readonly<Record<string, string>> = () => ({});
  private readonly hint: Hint;
  private figuresTimer = 0;
  private outside = false; // whether the view is from where nothing was filmed
  private played = false;
  private toldOfSound = false;

  constructor(host: ControlsHost, root: ShadowRoot, private readonly player: Player) {
    super(host, root);
    const { words } = this;
    const { signal } = player.stop;
    for (const [name, { color }] of Object.entries(BACKGROUNDS))
      this.part(`.swatch.${name}`).style.setProperty("--color", cssColor(color));
    const stage = this.part(".stage");
    this.timeline = new Timeline(this.part(".timeline"), player, new Thumbnails(player), words);
    this.hint = new Hint(this.part(".hint"));
    this.sheets = new Sheets(root, (name) => this.showSheet(name));
    this.motion = new Motion(stage, player, {
      tap: (pointer, x, y) => this.tapped(pointer, x, y),
      touched: () => {
        // Who has begun to look around does not need the invitation any more.
        this.part(".start").hidden = true;
        this.hint.turned();
        this.awake();
      },
      input: () => host.endIntro(),
    });
    this.motion.ownsWheel = () => this.isPage || document.fullscreenElement === host || root.activeElement === stage;
    for (const element of this.buttons("link")) element.hidden = !this.isPage;
    this.part("[data-act='full']").hidden = !document.fullscreenEnabled;
    for (const kind of ["vr", "ar"] as const)
      void hasImmersion(kind).then((has) => {
        for (const button of this.buttons(kind)) button.hidden = !has;
      });
    stage.addEventListener("dragover", (event) => {
      if (event.dataTransfer?.types.includes("Files") === true) event.preventDefault();
    }, { signal });
    stage.addEventListener("drop", (event) => {
      const file = event.dataTransfer?.files[0];
      if (file === undefined) return;
      event.preventDefault();
      if (/\.v3s$/i.test(file.name)) host.open(file);
      else this.notice(words.notStream(file.name));
    }, { signal });
    // Fingers on the image decide themselves; the comparison of the review keeps its events to itself, hence the capture.
    const stay = (event: PointerEvent): void => {
      const onControls = event.composedPath().some((part) => part instanceof Element && part.matches(".wipe, .bar"));
      if (onControls || event.pointerType === "mouse") this.awake();
    };
    for (const kind of ["pointerdown", "pointermove"] as const) host.addEventListener(kind, stay, { signal, capture: true });
    document.addEventListener("fullscreenchange", () => {
      const full = document.fullscreenElement === host;
      this.relabel("full", full ? ICONS.small : ICONS.full, full ? words.notFull : words.full);
    }, { signal });
    signal.addEventListener("abort", () => {
      this.immersive?.end();
      clearInterval(this.figuresTimer);
      this.clearTimers();
      this.hint.hide();
    });
    this.follow();
    if (player.info !== null) this.showOpened(player.info);
    if (host.state.ready) this.showReady();
  }

  // What the player does ----------------------------------------------------------------------------------------------

  private follow(): void {
    const { player } = this;
    player.on("opened", (info) => this.showOpened(info));
    player.on("ready", () => this.showReady());
    player.on("play", () => {
      this.say(this.words.playing);
      this.showPlaying(true);
      this.awake();
    });
    player.on("pause", () => {
      this.say(this.words.paused(player.seconds.toFixed(1), player.duration.toFixed(1)));
      this.showPlaying(false);
      this.awake();
    });
    player.on("frame", ({ frame, seconds }) => {
      this.timeline.update(frame);
      this.part(".now").textContent = clock(seconds);
    });
    player.on("grown", () => {
      this.part(".total").textContent = `/ ${clock(player.duration)}`;
      this.timeline.updateBuffered(player.stream);
    });
    player.on("fetched", () => this.timeline.updateBuffered(player.stream));
    player.on("view", () => this.fade());
    player.on("updated", () => {
      this.part(".update").hidden = false;
    });
    player.on("ended", () => this.say(this.words.end));
    player.on("sound", () => this.showSound());
    player.on("notice", () => this.timeline.updateBuffered(player.stream));
  }

  private showReady(): void {
    const { host, player } = this;
    this.timeline.update(player.frame);
    this.timeline.updateBuffered(player.stream);
    this.part(".now").textContent = clock(player.seconds);
    this.showPlaying(player.playing);
    this.showSound();
    this.fade();
    this.awake();
    if (host.hasAttribute("controls")) this.hint.show(this.motion.ownsWheel(), this.words);
  }

  private showOpened(info: StreamInfo): void {
    const { host, player } = this;
    this.part(".update").hidden = true;
    this.showChoices();
    const title = host.getAttribute("data-title") ?? info.title ?? "";
    const credits = [host.getAttribute("data-credits") ?? "", host.getAttribute("data-license") ?? ""];
    const names = credits.filter((text) => text !== "").join(" · ");
    this.part(".title").textContent = title;
    this.part(".credits").textContent = names;
    this.part(".head").hidden = !this.isPage || (title === "" && names === "");
    if (title !== "" && this.isPage) document.title = title;
    this.part(".stage").setAttribute("aria-label", [this.words.video, title].filter(Boolean).join(": "));
    this.part(".total").textContent = `/ ${clock(player.duration)}`;
    this.fade();
  }

  private showSound(): void {
    const { sound, muted } = this.player;
    this.part("[data-act='sound']").hidden = sound?.present !== true;
    this.relabel("sound", muted ? ICONS.silent : ICONS.sound, muted ? this.words.soundOn : this.words.soundOff);
    if (sound?.blocked !== true || this.toldOfSound) return;
    this.toldOfSound = true;
    this.notice(this.words.silent);
  }

  protected override showPlaying(playing: boolean): void {
    super.showPlaying(playing);
    // The large button is only shown before the first playback.
    this.part(".start").hidden = playing || this.played || this.player.isMoment;
    this.played ||= playing;
  }

  /** Fades the image where no camera filmed from nearby, down to a hint of it, and says why. */
  private fade(): void {
    const { visibility } = this.player;
    this.part(".stage > canvas").style.opacity = visibility < 1 ? String(FAINTEST + (1 - FAINTEST) * visibility) : "";
    const outside = visibility <= 0.5;
    if (outside && !this.outside) this.notice(this.words.outside);
    this.outside = outside;
  }

  protected mayHide(): boolean {
    return this.player.playing && this.sheets.open !== "settings" && this.immersive === null;
  }

  /** Tells screen readers only. */
  private say(text: string): void {
    this.part(".spoken").textContent = text;
  }

  /** Adds lines to *Help*. */
  addHelp(lines: readonly HelpLine[]): void {
    this.part(".help tbody").insertAdjacentHTML("afterbegin", lines.map(helpRow).join(""));
  }

  // What the viewer does ----------------------------------------------------------------------------------------------

  /** Plays or pauses for the viewer, whose input also allows sound. */
  togglePlay(): void {
    const { player, host } = this;
    if (player.playing) {
      host.pause();
      return;
    }
    if (player.sound?.blocked === true) host.setMuted(false);
    host.play();
  }

  toggleSound(): void {
    const { sound, muted } = this.player;
    if (sound?.present === true) this.host.setMuted(!muted);
  }

  skip(seconds: number): void {
    this.host.seek(Math.max(0, this.player.seconds + seconds));
  }

  step(frames: number): void {
    this.player.pause();
    this.timeline.seek(this.player.frame + frames);
  }

  changeSpeed(step: number): void {
    const now = this.player.speed;
    const faster = SPEEDS.filter((speed) => (step > 0 ? speed > now : speed < now));
    this.host.setSpeed(faster.at(step > 0 ? 0 : -1) ?? now);
    this.notice(this.words.chosen(this.words.speed, `${this.player.speed}×`));
  }

  nextBackground(): void {
    const names = (Object.keys(BACKGROUNDS) as BackgroundName[]).filter((name) => this.offers(name));
    const next = names[(names.indexOf(this.background) + 1) % names.length];
    this.host.setBackground(next);
    this.notice(this.words.chosen(this.words.background, this.words.backgrounds[next]));
  }

  /** Shares the page's link. A page with a review, which has `data-link`, asks which link: its own address would let others
   * change marks, so it is shared only when it is asked for by name. */
  share(): void {
    if (!this.isPage || this.player.info === null) return;
    if (this.host.hasAttribute("data-link")) {
      this.sheets.toggle("which");
      return;
    }
    const address = this.linkFrom(location.href);
    try {
      history.replaceState(null, "", address);
    } catch {
      // some browsers forbid it on pages that were opened from the disk
    }
    void this.giveLink(address, this.words.copied);
  }

  shareToWatch(): void {
    const base = new URL(this.host.getAttribute("data-link") ?? "", document.baseURI).href;
    void this.giveLink(this.linkFrom(base), this.words.copiedToWatch);
  }

  shareReview(): void {
    const address = this.linkFrom(location.href, this.reviewParameters());
    void this.giveLink(address, this.words.copiedReview);
  }

  private linkFrom(base: string, more: Readonly<Record<string, string>> = {}): string {
    return linkTo(base, this.player.seconds, this.player.view, more);
  }

  private async giveLink(address: string, done: string): Promise<void> {
    this.sheets.close();
    if (await shareLink(address, document.title)) return;
    if (await copyText(address, this.root)) {
      this.notice(done);
      return;
    }
    // To be copied by hand.
    this.sheets.show("copy");
    const field = this.root.querySelector<HTMLInputElement>(".address")!;
    field.value = address;
    field.focus({ preventScroll: true });
    field.select();
  }

  async toggleImmersion(kind: Immersion): Promise<void> {
    if (this.immersive !== null) {
      this.immersive.end();
      return;
    }
    if (!this.host.state.ready) return;
    this.sheets.close();
    try {
      this.immersive = await Immersive.start(kind, this.player, this.host, (placed) => this.notice(placed ? this.words.adjustAR : this.words.placeAR), () => {
        this.immersive = null;
        this.showImmersion(kind, false);
      });
      this.showImmersion(kind, true);
    } catch (error) {
      this.notice(this.words.unavailable(kind.toUpperCase(), messageOf(error)));
    }
  }

  private showImmersion(kind: Immersion, on: boolean): void {
    this.host.classList.toggle("ar", on && kind === "ar");
    for (const button of this.buttons(kind)) button.setAttribute("aria-pressed", String(on));
    this.awake();
  }

  private showSheet(name: SheetName | null): void {
    clearInterval(this.figuresTimer);
    if (name === "info") {
      const show = (): void => showFigures(this.part(".info tbody"), this.player, this.words);
      show();
      this.figuresTimer = setInterval(show, 500);
    }
    this.part("[data-act='settings']").setAttribute("aria-expanded", String(name === "settings"));
    this.part(".bar [data-act='info']").setAttribute("aria-pressed", String(name === "info"));
  }

  private tapped(pointer: string, x: number, y: number): void {
    this.part(".stage").focus({ preventScroll: true });
    if (this.sheets.open !== null && this.sheets.open !== "info") {
      this.sheets.close(false);
      return;
    }
    const start = this.part(".start");
    const box = start.getBoundingClientRect();
    if (!start.hidden && x >= box.left && x <= box.right && y >= box.top && y <= box.bottom) {
      this.host.play();
      return;
    }
    if (pointer === "mouse") return;
    // A tap shows the controls, another tap hides them.
    if (this.host.classList.contains("idle")) this.awake();
    else this.host.classList.add("idle");
  }

  // What is chosen in the settings ------------------------------------------------------------------------------------

  /** Does what a radio button says. */
  choose({ name, value }: HTMLInputElement): void {
    if (name === "speed") this.host.setSpeed(Number(value));
    else if (name === "loop") this.host.setLoop(value === "true");
    else this.host.setBackground(value as BackgroundName);
  }

  /** Shows speed, loop and background as they are. */
  showChoices(): void {
    const { suggested, background } = this;
    this.part(".swatch.stream").style.setProperty("--color", cssColor(suggested));
    for (const { value, parentElement: label } of this.radios("background"))
      label!.hidden = !this.offers(value as BackgroundName);
    this.check("background", isSuggested(background, suggested) ? "stream" : background);
    this.check("speed", String(this.player.speed));
    this.check("loop", String(this.host.state.loop));
  }

  private get background(): BackgroundName {
    const { background } = this.host;
    const chosen = isBackground(background) ? background : "set";
    return chosen === "set" && !this.hasSet ? "stream" : chosen;
  }

  private get hasSet(): boolean {
    return this.player.info?.hasSet === true;
  }

  private offers(name: BackgroundName): boolean {
    return name === "set" ? this.hasSet : !isSuggested(name, this.suggested);
  }

  /** The background of the stream, or black. */
  private get suggested(): Vector {
    return this.player.info?.background ?? BACKGROUNDS.black.color;
  }

  private check(group: "speed" | "loop" | "background", value: string): void {
    for (const radio of this.radios(group)) radio.checked = radio.value === value;
  }

  private radios(group: string): NodeListOf<HTMLInputElement> {
    return this.root.querySelectorAll<HTMLInputElement>(`[name=${group}]`);
  }

  /** Whether the player is the whole page. */
  private get isPage(): boolean {
    return this.host.hasAttribute("page");
  }

  private buttons(act: string): NodeListOf<HTMLElement> {
    return this.root.querySelectorAll<HTMLElement>(`[data-act='${act}']`);
  }
}
