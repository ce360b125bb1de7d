/**
 * `<v3-player src="...">`: the player with its controls. docs/WEB.md lists its attributes, methods and events.
 */

import type { PartialView, View } from "../render/camera.ts";
import { Player } from "../player/player.ts";
import { messageOf } from "../stream/errors.ts";
import type { Vector } from "../stream/metadata.ts";
import type { EmbeddedFiles } from "../worker/embedded.ts";
import type { DecodePath } from "../worker/messages.ts";
import { acceptDrops } from "./drop.ts";
import { clock } from "./format.ts";
import { ICONS } from "./icons.ts";
import { Intro, readPath } from "./intro.ts";
import { Hint } from "./hint.ts";
import { LinkSheet } from "./link_sheet.ts";
import { Motion } from "./motion.ts";
import { Panel } from "./panel.ts";
import css from "./style.css";
import { type BackgroundName, BACKGROUNDS, type HelpLine, helpRow, isBackground, SPEEDS, TEMPLATE } from "./template.ts";
import { Timeline } from "./timeline.ts";
import { hasImmersion, type Immersion, Immersive } from "../xr/immersive.ts";

/** Milliseconds without user input until the controls hide. */
const IDLE = 3000;
const NOTICE = 5000;
/** Opacity of the image where nothing was filmed. */
const FAINTEST = 0.1;

/** The type of `state`, which is also sent to a page that embeds the player in an iframe. */
export interface PlayerState {
  readonly ready: boolean;
  readonly playing: boolean;
  readonly seconds: number;
  readonly duration: number;
  readonly frame: number;
  readonly frameCount: number;
  readonly speed: number;
  readonly loop: boolean;
  readonly live: boolean;
  /** Whether sound is off; null if the stream has none. */
  readonly muted: boolean | null;
  readonly view: View | null;
}

/** Files of a stream in this page: base64 in script elements below the element that `selector` names. */
function embeddedFiles(selector: string): EmbeddedFiles {
  const files: Record<string, string> = {};
  for (const script of document.querySelectorAll<HTMLElement>(`${selector} script[data-v3-file]`))
    files[script.dataset["v3File"]!] = script.textContent;
  return files;
}

export class V3PlayerElement extends HTMLElement {
  static readonly observedAttributes = ["src", "poster", "background", "loop", "controls", "data-description"];

  private player: Player | null = null;
  private motion: Motion | null = null;
  private timeline: Timeline | null = null;
  private panel: Panel | null = null;
  private hint: Hint | null = null;
  private readonly root: ShadowRoot;
  /** What *Copy link* does; not part of the stable interface. */
  readonly links: LinkSheet;
  private lifetime: AbortController | null = null;
  private idleTimer = 0;
  private noticeTimer = 0;
  /** Whether the view is from where nothing was filmed. */
  private outside = false;
  private isReady = false;
  /** Time and view of a link, applied once the stream has been opened. */
  private startAt: number | null = null;
  private startView: PartialView | null = null;
  private intro: Intro | null = null;
  private wantsToPlay = false;
  private suggested: Vector | null = null;
  private backgroundName: BackgroundName = "stream";

  constructor() {
    super();
    this.root = this.attachShadow({ mode: "open" });
    this.links = new LinkSheet({
      root: this.root,
      watching: () => this.getAttribute("data-link"),
      place: () => (this.player?.info ? this.player : null),
      notice: (message) => this.notice(message),
    });
  }

  connectedCallback(): void {
    this.root.innerHTML = `<style>${css}</style>${TEMPLATE}`;
    this.lifetime = new AbortController();
    this.isReady = false;
    const path = this.getAttribute("decoder") as DecodePath | "auto" | null;
    try {
      const loop = this.hasAttribute("loop");
      this.player = new Player(this.part_("canvas"), { loop, path: path ?? "auto" });
    } catch (error) {
      this.showFailure(messageOf(error));
      return;
    }
    this.wire(this.player, this.lifetime.signal);
    const background = this.getAttribute("background");
    this.setBackground(isBackground(background) ? background : "stream");
    this.applyAttributes();
    this.open();
    for (const kind of ["vr", "ar"] as const)
      void hasImmersion(kind).then((has) => {
        for (const button of this.root.querySelectorAll<HTMLElement>(`[data-act="${kind}"]`)) button.hidden = !has;
      });
  }

  disconnectedCallback(): void {
    this.immersive?.end();
    this.intro?.stop();
    this.intro = null;
    this.lifetime?.abort();
    clearTimeout(this.idleTimer);
    clearTimeout(this.noticeTimer);
    this.panel?.toggle(false);
    this.hint?.hide();
    this.motion?.dispose();
    this.player?.dispose();
    this.player = null;
    this.motion = null;
    this.root.replaceChildren();
  }

  attributeChangedCallback(name: string, before: string | null, now: string | null): void {
    if (this.player === null || before === now) return;
    if (name === "src") this.open();
    else this.applyAttributes();
    if (name === "background" && isBackground(now)) this.setBackground(now);
    if (name === "loop") this.setLoop(now !== null);
  }

  // Public interface --------------------------------------------------------------------------------------------------

  play(): void {
    this.wantsToPlay = true;
    this.player?.play();
  }

  pause(): void {
    this.wantsToPlay = false;
    this.player?.pause();
  }

  /** Seeks to a time in seconds. */
  seek(seconds: number): void {
    if (!this.player?.info) this.startAt = seconds;
    else this.timeline?.seek(Math.floor(seconds * this.player.info.fps + 1e-6));
  }

  /** Sets the view; see `state.view`. What is missing stays as it is. */
  setView(view: PartialView): void {
    this.endIntro();
    if (!this.player?.info) this.startView = { ...this.startView, ...view };
    else this.player.view = view;
  }

  /** Goes back to the initial view. */
  resetView(): void {
    this.endIntro();
    if (this.player?.info) this.motion?.reset();
    else this.startView = null;
  }

  /** Sets the playback speed, 0.1 to 4; 1 is that of the recording. */
  setSpeed(speed: number): void {
    if (this.player === null) return;
    this.player.speed = speed;
    this.check("speed", String(this.player.speed));
  }

  /** Turns the sound off or on. Browsers may refuse to turn it on before the viewer has touched the page. */
  setMuted(muted: boolean): void {
    if (this.player !== null) this.player.sound.muted = muted;
  }

  get state(): PlayerState {
    const { player } = this;
    return {
      ready: this.isReady,
      playing: player?.playing ?? false,
      seconds: player?.seconds ?? 0,
      duration: player?.duration ?? 0,
      frame: player?.frame ?? 0,
      frameCount: player?.info?.frameCount ?? 0,
      speed: player?.speed ?? 1,
      loop: player?.loop ?? false,
      live: player?.info?.live ?? false,
      muted: player?.info?.hasSound === true ? player.sound.muted : null,
      view: !player?.info ? null : player.view,
    };
  }

  /** The player without controls, for the benchmark and tests; not part of the stable interface. */
  get engine(): Player | null {
    return this.player;
  }

  // Implementation ----------------------------------------------------------------------------------------------------

  // The caller knows the element's type from the template.
  // eslint-disable-next-line @typescript-eslint/no-unnecessary-type-parameters
  private part_<T extends Element = Element>(selector: string): T {
    return this.root.querySelector<T>(selector)!;
  }

  private tell(event: string, detail: unknown = null): void {
    this.dispatchEvent(new CustomEvent(`v3-${event}`, { detail, bubbles: true, composed: true }));
  }

  /** Opens a stream in one file (`.v3s`) on this computer. */
  openFile(file: File): void {
    this.open(file);
  }

  /** Goes to the newest group of a live stream. */
  seekLive(): void {
    this.player?.seekLive();
  }

  private open(file: File | null = null): void {
    const source = file === null ? this.getAttribute("src") : file.name;
    this.part_<HTMLElement>(".failure").hidden = true;
    if (source === null || source === "" || this.player === null) return;
    this.isReady = false;
    this.introEnded = false;
    this.busy(true);
    const poster = this.part_<HTMLElement>(".poster");
    poster.classList.remove("gone");
    const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.wantsToPlay ||= this.hasAttribute("autoplay") && !calm;
    try {
      const embedded = file === null && source.startsWith("#") ? embeddedFiles(source) : null;
      this.player.open(source, embedded, file);
    } catch (error) {
      this.showFailure(`The address "${source}" cannot be opened: ${messageOf(error)}.`);
    }
  }

  private applyAttributes(): void {
    const poster = this.part_<HTMLImageElement>(".poster");
    const address = this.getAttribute("poster");
    poster.hidden = address === null;
    if (address !== null) poster.src = address;
    this.part_<HTMLElement>(".bar").hidden = this.getAttribute("controls") === "none";
    this.part_("#about").textContent = this.getAttribute("data-description") ?? "";
  }

  private wire(player: Player, signal: AbortSignal): void {
    const stage = this.part_<HTMLElement>(".stage");
    this.timeline = new Timeline(this.part_(".timeline"), player);
    this.panel = new Panel(this.part_(".info"), player);
    this.hint = new Hint(this.part_(".hint"));
    const motion = (this.motion = new Motion(stage, player, {
      tap: (pointer, x, y) => this.tapped(pointer, x, y),
      touched: () => {
        // Who has begun to look around does not need the invitation any more.
        this.part_<HTMLElement>(".start").hidden = true;
        this.hint?.turned();
        this.awake();
      },
      input: () => this.endIntro(),
    }));
    motion.ownsWheel = () => this.hasAttribute("page") || document.fullscreenElement === this || this.root.activeElement === stage;

    for (const element of this.root.querySelectorAll<HTMLElement>("[data-act='link']"))
      element.hidden = !this.hasAttribute("page");
    this.part_<HTMLElement>("[data-act='full']").hidden = !document.fullscreenEnabled;

    player.on("opened", (info) => {
      this.suggested = info.background;
      this.setBackground(this.backgroundName);
      const title = this.getAttribute("data-title") ?? info.title;
      this.part_(".title").textContent = title;
      const credits = [this.getAttribute("data-credits"), this.getAttribute("data-license")];
      const names = credits.filter((text) => text !== null && text !== "").join(" · ");
      this.part_(".credits").textContent = names;
      this.part_<HTMLElement>(".head").hidden = !this.hasAttribute("page") || ((title ?? "") === "" && names === "");
      if (title !== null && this.hasAttribute("page")) document.title = title;
      this.part_(".stage").setAttribute("aria-label", title === null || title === "" ? "Volumetric video" : `Volumetric video: ${title}`);
      this.part_(".total").textContent = `/ ${clock(player.duration)}`;
      this.mayIntroduce = this.startView === null && this.startAt === null;
      // Who opens a link to a moment wants to see it.
      this.isMoment = this.startAt !== null;
      if (this.startView !== null) player.view = this.startView;
      if (this.startAt !== null) player.seek(this.startAt);
      this.startView = this.startAt = null;
      this.fade(player.visibility);
      this.tell("opened", { frameCount: info.frameCount, fps: info.fps, duration: player.duration, title: info.title });
    });
    player.on("ready", () => {
      this.isReady = true;
      this.busy(false);
      this.part_(".poster").classList.add("gone");
      this.timeline?.updateBuffered();
      if (this.wantsToPlay) player.play();
      else this.showPlaying(false);
      this.awake();
      this.tell("ready", this.state);
      if (this.getAttribute("controls") !== "none") this.hint?.show(this.motion?.ownsWheel() ?? false);
      void this.introduce(player);
    });
    player.on("play", () => {
      this.say("Playing");
      this.showPlaying(true);
      this.awake();
      this.tell("play");
    });
    player.on("pause", () => {
      this.say(`Paused at ${this.position()}`);
      this.showPlaying(false);
      this.awake();
      this.tell("pause");
    });
    player.on("frame", ({ frame, seconds }) => {
      this.timeline?.update(frame);
      this.part_(".now").textContent = clock(seconds);
      this.tell("time", { frame, seconds });
    });
    player.on("grown", (info) => {
      this.part_(".total").textContent = `/ ${clock(player.duration)}`;
      this.timeline?.updateBuffered();
      this.tell("grown", { frameCount: info.frameCount, duration: player.duration, live: info.live });
    });
    player.on("fetched", () => this.timeline?.updateBuffered());
    player.on("view", (view) => {
      this.fade(player.visibility);
      this.tell("view", view);
    });
    player.on("waiting", (waiting) => {
      this.busy(waiting);
      this.tell("waiting", waiting);
    });
    player.on("ended", () => {
      this.say("The end");
      this.tell("ended");
    });
    player.on("looped", () => this.tell("looped"));
    player.on("sound", () => this.showSound(player));
    player.on("notice", (message) => {
      this.timeline?.updateBuffered();
      this.notice(message);
      this.tell("notice", message);
    });
    player.on("failed", (message) => {
      this.showFailure(message);
      this.tell("error", message);
    });

    acceptDrops(stage, (file) => this.openFile(file), (name) => {
      this.notice(`${name} is not a stream in one file (.v3s).`);
    }, signal);
    this.root.addEventListener("click", (event) => this.clicked(event), { signal });
    this.addEventListener("keydown", (event) => this.keyDown(event), { signal });
    this.addEventListener("keyup", (event) => {
      motion.shift = event.shiftKey;
      motion.key(event.key, false);
    }, { signal });
    this.addEventListener("pointermove", (event) => {
      if (event.pointerType === "mouse") this.awake();
    }, { signal });
    // The comparison of the review lies over the image and keeps its pointer events to itself.
    this.addEventListener("pointerdown", (event) => {
      if (event.composedPath().some((part) => part instanceof Element && part.classList.contains("wipe"))) this.awake();
    }, { signal, capture: true });
    document.addEventListener("fullscreenchange", () => {
      const full = document.fullscreenElement === this;
      const button = this.part_<HTMLElement>("[data-act='full']");
      button.innerHTML = full ? ICONS.small : ICONS.full;
      button.title = full ? "Exit full screen" : "Full screen";
      button.setAttribute("aria-label", button.title);
    }, { signal });
    this.setLoop(this.hasAttribute("loop"));
    this.check("speed", "1");
  }

  private clicked(event: Event): void {
    const target = (event.target as Element).closest<HTMLElement>("button");
    if (target === null) return;
    const { act, speed, background, loop } = target.dataset;
    if (speed !== undefined) this.setSpeed(Number(speed));
    if (loop !== undefined) this.setLoop(loop === "true");
    if (background !== undefined && isBackground(background)) this.setBackground(background);
    // A pointer on the large button turns the view, or taps, as everywhere on the stage.
    if (act === "start" && (event as MouseEvent).detail === 0) this.play();
    if (act === "help") this.toggleHelp();
    if (act === "play") this.togglePlay();
    if (act === "sound") this.toggleSound();
    if (act === "reset") this.motion?.reset();
    if (act === "settings") this.toggleSettings();
    if (act === "info") this.toggleInfo();
    if (act === "link") this.copyLink();
    if (act === "link-watch") void this.links.copyToWatch();
    if (act === "link-review") void this.links.copyToReview();
    if (act === "copy-close") this.links.hide();
    if (act === "full") void this.toggleFull();
    if (act === "vr" || act === "ar") void this.toggleImmersion(act);
    if (act === "again") {
      this.part_<HTMLElement>(".failure").hidden = true;
      this.open();
    }
    this.awake();
  }

  private keyDown(event: KeyboardEvent): void {
    const { motion, player } = this;
    if (motion === null || player === null || event.altKey || event.metaKey || event.ctrlKey) return;
    if (event.key !== "Shift" && event.key !== "Tab") this.endIntro();
    const from = event.composedPath()[0] as Element;
    motion.shift = event.shiftKey;
    // The link to copy by hand is selected and copied with keys.
    if (from.tagName === "INPUT" && event.key !== "Escape") return;
    // Anyone who has a keyboard may want to know its keys.
    this.classList.add("has-keys");
    // Space also presses a focused button.
    const onButton = from.tagName === "BUTTON";
    const actions: Record<string, () => void> = {
      " ": () => this.togglePlay(),
      k: () => this.togglePlay(),
      j: () => this.seek(Math.max(0, player.seconds - 1)),
      l: () => this.seek(player.seconds + 1),
      ",": () => {
        player.pause();
        this.timeline?.seek(player.frame - 1);
      },
      "<": () => this.changeSpeed(-1),
      ">": () => this.changeSpeed(1),
      b: () => {
        const names = (Object.keys(BACKGROUNDS) as BackgroundName[]).filter((name) => !this.isSuggested(name));
        const next = names[(names.indexOf(this.backgroundName) + 1) % names.length];
        this.setBackground(next);
        this.notice(`Background: ${BACKGROUNDS[next].label}.`);
      },
      "?": () => this.toggleHelp(),
      ".": () => {
        player.pause();
        this.timeline?.seek(player.frame + 1);
      },
      r: () => motion.reset(),
      f: () => void this.toggleFull(),
      i: () => this.toggleInfo(),
      m: () => this.toggleSound(),
      c: () => {
        if (this.hasAttribute("page")) this.copyLink();
      },
      Escape: () => {
        this.toggleSettings(false);
        this.toggleHelp(false);
        this.links.hide();
        this.panel?.toggle(false);
      },
    };
    // Letters also with Caps Lock.
    const name = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    const action = onButton && event.key === " " ? undefined : actions[name];
    if (action !== undefined) action();
    else if (onButton || !motion.key(event.key, true)) return;
    event.preventDefault();
    this.awake();
  }

  private tapped(pointer: string, x: number, y: number): void {
    this.part_<HTMLElement>(".stage").focus({ preventScroll: true });
    if (!this.part_<HTMLElement>(".settings").hidden || !this.part_<HTMLElement>(".help").hidden) {
      this.toggleSettings(false);
      this.toggleHelp(false);
      return;
    }
    const start = this.part_<HTMLElement>(".start");
    const box = start.getBoundingClientRect();
    if (!start.hidden && x >= box.left && x <= box.right && y >= box.top && y <= box.bottom) {
      this.play();
      return;
    }
    if (pointer === "mouse") return;
    // A tap shows the controls, another tap hides them.
    if (this.classList.contains("idle")) this.awake();
    else this.classList.add("idle");
  }

  /** By the viewer, whose input also allows sound. */
  private togglePlay(): void {
    if (this.player?.playing === true) {
      this.pause();
      return;
    }
    if (this.player?.sound.blocked === true) this.player.sound.muted = false;
    this.play();
  }

  private toggleSound(): void {
    const { player } = this;
    if (player?.sound.present === true) player.sound.muted = !player.sound.muted;
  }

  private showSound(player: Player): void {
    const { sound } = player;
    const button = this.part_<HTMLElement>("[data-act='sound']");
    button.hidden = !sound.present;
    button.innerHTML = sound.muted ? ICONS.silent : ICONS.sound;
    button.title = sound.muted ? "Turn sound on" : "Turn sound off";
    button.setAttribute("aria-label", button.title);
    if (sound.blocked && !this.toldOfSound) {
      this.toldOfSound = true;
      this.notice("The browser starts without sound. Turn it on with the button below.");
    }
    this.tell("sound", { muted: sound.muted, volume: sound.volume });
  }

  private toldOfSound = false;

  private showPlaying(playing: boolean): void {
    const button = this.part_<HTMLElement>(".bar [data-act='play']");
    button.innerHTML = playing ? ICONS.pause : ICONS.play;
    button.title = playing ? "Pause" : "Play";
    button.setAttribute("aria-label", button.title);
    // The large button is only shown before the first playback.
    const start = this.part_<HTMLElement>(".start");
    start.hidden = playing || this.played || this.isMoment;
    this.played ||= playing;
  }

  private played = false;
  /** Whether a link to a moment was opened. */
  private isMoment = false;

  /** Adds lines to *Help*; not part of the stable interface. */
  addHelp(lines: readonly HelpLine[]): void {
    this.part_(".help tbody").insertAdjacentHTML("afterbegin", lines.map(helpRow).join(""));
  }

  private toggleSettings(open = this.part_<HTMLElement>(".settings").hidden): void {
    this.part_<HTMLElement>(".settings").hidden = !open;
    this.part_("[data-act='settings']").setAttribute("aria-expanded", String(open));
  }

  private toggleHelp(open = this.part_<HTMLElement>(".help").hidden): void {
    const help = this.part_<HTMLElement>(".help");
    if (help.hidden === !open) return;
    help.hidden = !open;
    if (open) {
      this.toggleSettings(false);
      this.panel?.toggle(false);
      help.focus();
    } else this.part_<HTMLElement>(".stage").focus({ preventScroll: true });
  }

  private changeSpeed(step: number): void {
    const now = this.player?.speed ?? 1;
    const faster = SPEEDS.filter((speed) => (step > 0 ? speed > now : speed < now));
    const next = step > 0 ? faster[0] : faster[faster.length - 1];
    if ((next as number | undefined) !== undefined) this.setSpeed(next);
    this.notice(`Speed: ${this.player?.speed ?? 1}×.`);
  }

  /** Flies the attribute's camera path, unless a link asks for a view or motion is unwanted. */
  private async introduce(player: Player): Promise<void> {
    const place = this.getAttribute("intro");
    if (place === null || !this.mayIntroduce || matchMedia("(prefers-reduced-motion: reduce)").matches) return;
    this.mayIntroduce = false;
    try {
      const text = place.startsWith("#")
        ? (document.querySelector(place)?.textContent ?? "")
        : await fetch(new URL(place, document.baseURI)).then((response) => response.text());
      // Meanwhile, the user may have moved the camera.
      if (player !== this.player || this.introEnded) return;
      this.intro = new Intro(player, readPath(text, player), () => this.endIntro());
    } catch (error) {
      this.notice(messageOf(error));
    }
  }

  private mayIntroduce = false;
  private introEnded = false;

  private endIntro(): void {
    this.introEnded = true;
    if (this.intro === null) return;
    this.intro.stop();
    this.intro = null;
    this.tell("intro-ended");
  }

  /** For screen readers only. */
  private say(text: string): void {
    this.part_(".spoken").textContent = text;
  }

  private position(): string {
    const { seconds, duration } = this.state;
    return `${seconds.toFixed(1)} of ${duration.toFixed(1)} seconds`;
  }

  private toggleInfo(): void {
    this.toggleSettings(false);
    this.toggleHelp(false);
    this.panel?.toggle();
    this.part_(".bar [data-act='info']").setAttribute("aria-pressed", String(this.panel?.open ?? false));
  }

  /** The session in a headset or on the camera's image; null if there is none. Not part of the stable interface. */
  immersive: Immersive | null = null;

  private async toggleImmersion(kind: Immersion): Promise<void> {
    if (this.immersive !== null) {
      this.immersive.end();
      return;
    }
    if (this.player === null || !this.isReady) return;
    this.toggleSettings(false);
    try {
      this.immersive = await Immersive.start(kind, this.player, this, {
        hint: (text) => this.notice(text),
        ended: () => {
          this.immersive = null;
          this.showImmersion(kind, false);
        },
      });
      this.showImmersion(kind, true);
    } catch (error) {
      this.notice(`${kind.toUpperCase()} is not available: ${messageOf(error)}.`);
    }
  }

  private showImmersion(kind: Immersion, on: boolean): void {
    this.classList.toggle("ar", on && kind === "ar");
    for (const button of this.root.querySelectorAll(`[data-act="${kind}"]`)) button.setAttribute("aria-pressed", String(on));
    this.awake();
  }

  private async toggleFull(): Promise<void> {
    try {
      if (document.fullscreenElement === this) await document.exitFullscreen();
      else await this.requestFullscreen();
    } catch (error) {
      this.notice(`Full screen is not available: ${messageOf(error)}.`);
    }
  }

  private copyLink(): void {
    if (!this.player?.info) return;
    this.toggleSettings(false);
    void this.links.copy();
  }

  /** Whether playback starts over at the end. */
  setLoop(loop: boolean): void {
    if (this.player !== null && this.player.loop !== loop) this.player.loop = loop;
    this.check("loop", String(loop));
  }

  /** What is behind the splats: a name as in the URL parameters. */
  setBackground(name: BackgroundName): void {
    this.backgroundName = name;
    const color = name === "stream" ? (this.suggested ?? BACKGROUNDS.black.color) : BACKGROUNDS[name].color;
    if (this.player !== null) this.player.background = color;
    const paint = color === null ? "" : `rgb(${color.map((value) => Math.round(255 * value)).join(" ")})`;
    this.style.backgroundColor = color === null ? "transparent" : paint;
    const suggested = this.suggested ?? [0, 0, 0];
    this.part_<HTMLElement>(".swatch.stream").style.setProperty(
      "--color",
      `rgb(${suggested.map((value) => Math.round(255 * value)).join(" ")})`,
    );
    for (const swatch of this.root.querySelectorAll<HTMLElement>(".swatch"))
      swatch.hidden = this.isSuggested(swatch.dataset["background"] as BackgroundName);
    this.check("background", this.isSuggested(name) ? "stream" : name);
  }

  /** Whether a background looks like the one that the stream suggests, which is enough to choose from. */
  private isSuggested(name: BackgroundName): boolean {
    const { color } = BACKGROUNDS[name];
    const suggested = this.suggested ?? BACKGROUNDS.black.color;
    return color !== null && color.every((value, channel) => Math.abs(value - suggested[channel]) < 0.02);
  }

  private check(group: "speed" | "loop" | "background", value: string): void {
    for (const element of this.root.querySelectorAll<HTMLElement>(`[data-${group}]`))
      element.setAttribute("aria-checked", String(element.dataset[group] === value));
  }

  private busy(busy: boolean): void {
    this.part_(".veil").classList.toggle("busy", busy);
  }

  /** Shows the controls for a while. */
  private awake(): void {
    this.classList.remove("idle");
    clearTimeout(this.idleTimer);
    this.idleTimer = setTimeout(() => {
      const open = !this.part_<HTMLElement>(".settings").hidden;
      if (this.player?.playing === true && !open && this.immersive === null) this.classList.add("idle");
    }, IDLE);
  }

  notice(message: string): void {
    const element = this.part_<HTMLElement>(".notice");
    element.textContent = message;
    element.classList.add("shown");
    clearTimeout(this.noticeTimer);
    this.noticeTimer = setTimeout(() => element.classList.remove("shown"), NOTICE);
  }

  /** Fades the image where no camera filmed from nearby, down to a hint of it, and says why. */
  private fade(visibility: number): void {
    const canvas = this.part_<HTMLElement>(".stage > canvas");
    canvas.style.opacity = visibility < 1 ? String(FAINTEST + (1 - FAINTEST) * visibility) : "";
    const outside = visibility <= 0.5;
    if (outside && !this.outside) this.notice("Not filmed from here.");
    this.outside = outside;
  }

  private showFailure(message: string): void {
    this.busy(false);
    this.part_(".why").textContent = message;
    this.part_<HTMLElement>(".failure").hidden = false;
  }
}
