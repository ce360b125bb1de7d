/** `<v3-player src="...">`: the player with its controls. docs/guides/web.md lists its attributes, methods and events. */

import type { PartialView } from "../render/camera.ts";
import { Player } from "../player/player.ts";
import { messageOf } from "../stream/errors.ts";
import type { EmbeddedFiles } from "../worker/source.ts";
import { type HelpLine, listen } from "./actions.ts";
import { type BackgroundName, isBackground, isDecoder } from "./choices.ts";
import { Controls, type ControlsHost } from "./controls.ts";
import { flyPath, loadPath } from "./intro.ts";
import { parseView } from "./link.ts";
import css from "./style.css";
import { helpRow, TEMPLATE } from "./template.ts";
import { readBackground, readSeconds, readSpeed, readSwitch, readView } from "./values.ts";

/** Files of a stream in this page: base64 in script elements below the element that `selector` names. */
function embeddedFiles(selector: string): EmbeddedFiles {
  const scripts = document.querySelectorAll<HTMLElement>(`${selector} script[data-v3-file]`);
  return Object.fromEntries(Array.from(scripts, (script) => [script.dataset["v3File"]!, script.textContent]));
}

const reducesMotion = (): boolean => matchMedia("(prefers-reduced-motion: reduce)").matches;

export class V3PlayerElement extends HTMLElement implements ControlsHost {
  static readonly observedAttributes = ["src", "poster", "background", "loop", "data-description"];

  private readonly root: ShadowRoot;
  /** The player without controls; not part of the stable interface. */
  engine: Player | null = null;
  /** Not part of the stable interface. */
  controls: Controls | null = null;
  private lifetime: AbortController | null = null;
  private isReady = false;
  private wantsToPlay = false;
  /** Time and view of a link, applied once the stream has been opened. */
  private startAt: number | null = null;
  private startView: PartialView | null = null;
  /** Stops the intro that is flown. */
  private intro: (() => void) | null = null;
  private introWanted = false;

  constructor() {
    super();
    this.root = this.attachShadow({ mode: "open" });
  }

  connectedCallback(): void {
    this.root.innerHTML = `<style>${css}</style>${TEMPLATE}`;
    this.lifetime = new AbortController();
    this.isReady = false;
    const path = this.getAttribute("decoder");
    const canvas = this.root.querySelector("canvas")!;
    try {
      this.engine = new Player(canvas, { loop: this.hasAttribute("loop"), path: isDecoder(path) ? path : "auto" });
    } catch (error) {
      this.showFailure(messageOf(error));
      return;
    }
    this.controls = new Controls(this, this.root, this.engine, this.lifetime.signal);
    listen(this, this.root, this.controls, this.lifetime.signal);
    this.engine.sound.muted = this.hasAttribute("muted");
    this.announce(this.engine);
    const background = this.getAttribute("background");
    this.setBackground(isBackground(background) ? background : "stream");
    this.applyAttributes();
    this.open();
  }

  disconnectedCallback(): void {
    this.intro?.();
    this.lifetime?.abort();
    this.engine?.dispose();
    this.intro = this.controls = this.engine = null;
    this.root.replaceChildren();
  }

  attributeChangedCallback(name: string, before: string | null, now: string | null): void {
    if (this.engine === null || before === now) return;
    if (name === "src") this.open();
    else this.applyAttributes();
    if (name === "background" && isBackground(now)) this.setBackground(now);
    if (name === "loop") this.setLoop(now !== null);
  }

  // Public interface --------------------------------------------------------------------------------------------------

  play(): void {
    this.wantsToPlay = true;
    this.engine?.play();
  }

  pause(): void {
    this.wantsToPlay = false;
    this.engine?.pause();
  }

  /** Seeks to a time in seconds; before the first frame or after the last, to that frame. RangeError: not a finite number. */
  seek(seconds: number): void {
    readSeconds(seconds);
    if (!this.engine?.info) this.startAt = seconds;
    else this.controls?.timeline.seek(Math.floor(seconds * this.engine.info.fps + 1e-6));
  }

  /** Goes to the newest group of a live stream. */
  seekLive(): void {
    this.engine?.seekLive();
  }

  /** Sets the view; see `state.view`. What is missing stays as it is. `view`: an object, or text as in links. RangeError: not
   * a view. */
  setView(view: PartialView | string): void {
    const given = readView(view);
    this.endIntro();
    if (!this.engine?.info) this.startView = { ...this.startView, ...given };
    else this.engine.view = given;
  }

  /** Goes back to the initial view. */
  resetView(): void {
    this.endIntro();
    if (this.engine?.info) this.controls?.motion.reset();
    else this.startView = null;
  }

  /** Sets the playback speed, 0.1 to 4; 1 is that of the recording. RangeError: not such a number. */
  setSpeed(speed: number): void {
    const given = readSpeed(speed);
    this.controls?.setSpeed(given);
  }

  /** Whether playback starts over at the end. */
  setLoop(loop: boolean): void {
    const given = readSwitch(loop, "setLoop");
    this.controls?.setLoop(given);
  }

  /** What is behind the splats: a name as in the URL parameters. RangeError: another name. */
  setBackground(name: BackgroundName): void {
    const given = readBackground(name);
    this.controls?.setBackground(given);
  }

  /** Turns the sound off or on. Browsers may refuse to turn it on before the viewer has touched the page. */
  setMuted(muted: boolean): void {
    readSwitch(muted, "setMuted");
    if (this.engine !== null) this.engine.sound.muted = muted;
  }

  /** Opens a stream in one file (`.v3s`) on this computer. */
  openFile(file: File): void {
    this.open(file);
  }

  /** Also sent to a page that embeds the player in an iframe. `muted` is null without sound, `view` before the stream is open. */
  get state() {
    const { engine: player } = this;
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

  // For this package and its tests; not part of the stable interface --------------------------------------------------

  /** Adds lines to *Help*. */
  addHelp(lines: readonly HelpLine[]): void {
    this.root.querySelector(".help tbody")!.insertAdjacentHTML("afterbegin", lines.map(helpRow).join(""));
  }

  notice(message: string): void {
    this.controls?.notice(message);
  }

  /** Opens the stream of the attribute `src`, or a stream in one file. */
  open(file: File | null = null): void {
    const source = this.getAttribute("src") ?? "";
    this.find(".failure").hidden = true;
    if ((file === null && source === "") || this.engine === null) return;
    this.isReady = false;
    this.introWanted = this.hasAttribute("intro") && !reducesMotion();
    this.controls?.busy(true);
    this.find(".poster").classList.remove("gone");
    this.wantsToPlay ||= this.hasAttribute("autoplay") && !reducesMotion();
    try {
      void this.engine.open(file ?? (source.startsWith("#") ? embeddedFiles(source) : source));
    } catch (error) {
      this.showFailure(`The address "${source}" cannot be opened: ${messageOf(error).replace(/\.$/, "")}.`);
    }
  }

  /** Opens what has taken the stream's place, at the same time and view. */
  openUpdated(): void {
    const { engine: player } = this;
    if (player?.info) {
      this.startAt = player.seconds;
      this.startView = player.view;
      this.wantsToPlay = player.playing;
    }
    this.open();
  }

  endIntro(): void {
    this.introWanted = false;
    if (this.intro === null) return;
    this.intro();
    this.intro = null;
    this.tell("intro-ended");
  }

  // Implementation ----------------------------------------------------------------------------------------------------

  private find(selector: string): HTMLElement {
    return this.root.querySelector<HTMLElement>(selector)!;
  }

  private tell(event: string, detail: unknown = null): void {
    this.dispatchEvent(new CustomEvent(`v3-${event}`, { detail, bubbles: true, composed: true }));
  }

  private applyAttributes(): void {
    const poster = this.root.querySelector<HTMLImageElement>(".poster")!;
    const address = this.getAttribute("poster");
    poster.hidden = address === null;
    if (address !== null) poster.src = address;
    this.find("#about").textContent = this.getAttribute("data-description") ?? "";
  }

  /** Dispatches the player's events as those of the element, after the controls have shown them. */
  private announce(player: Player): void {
    player.on("opened", (info) => {
      this.introWanted &&= this.startView === null && this.startAt === null;
      this.controls!.isMoment = this.startAt !== null;
      const first = parseView(this.getAttribute("view"));
      if (first !== null) player.camera.begin(first);
      if (this.startView !== null) player.view = this.startView;
      if (this.startAt !== null) player.seek(this.startAt);
      this.startView = this.startAt = null;
      this.tell("opened", { frameCount: info.frameCount, fps: info.fps, duration: player.duration, title: info.title });
    });
    player.on("ready", () => {
      this.isReady = true;
      if (this.wantsToPlay) player.play();
      this.tell("ready", this.state);
      void this.introduce(player);
    });
    for (const name of ["play", "pause", "ended", "looped"] as const) player.on(name, () => this.tell(name));
    for (const name of ["view", "waiting", "notice"] as const) player.on(name, (detail: unknown) => this.tell(name, detail));
    player.on("frame", (detail) => this.tell("time", detail));
    player.on("grown", ({ frameCount, live }) => this.tell("grown", { frameCount, duration: player.duration, live }));
    player.on("sound", () => this.tell("sound", { muted: player.sound.muted, volume: player.sound.element.volume }));
    player.on("updated", () => {
      this.tell("updated");
      // Before the first image, there is nothing to be kept.
      if (!this.isReady) this.openUpdated();
    });
    player.on("failed", (message) => {
      this.showFailure(message);
      this.tell("error", message);
    });
  }

  /** Flies the attribute's camera path, unless a link asks for a view or the viewer has moved the camera meanwhile. */
  private async introduce(player: Player): Promise<void> {
    const place = this.getAttribute("intro");
    const wanted = (): boolean => this.introWanted && player === this.engine;
    if (place === null || !wanted()) return;
    try {
      const path = await loadPath(place, player);
      if (wanted()) this.intro = flyPath(player, path, () => this.endIntro());
    } catch (error) {
      this.notice(messageOf(error));
    }
    this.introWanted = false;
  }

  private showFailure(message: string): void {
    this.controls?.busy(false);
    this.find(".why").textContent = message;
    this.find(".failure").hidden = false;
  }
}
