/** `<v3-player src="...">`: the first image, and the interface for scripts. What is needed later is in rest.ts.
 * docs/guides/web.md lists attributes, methods and events. */

import type { PartialView, View } from "../render/camera.ts";
import { Player } from "../player/player.ts";
import { messageOf } from "../stream/errors.ts";
import type { EmbeddedFiles } from "../worker/source.ts";
import { backdropOf, type BackgroundName, BACKGROUNDS, cssColor, isBackground, isDecoder, isLight } from "./choices.ts";
import { claim, release, type Tenant, watch } from "./contexts.ts";
import type { Controls, ControlsHost } from "./controls.ts";
import { addStyle } from "./dom.ts";
import css from "./first.css";
import { firstTemplate, languageOf, setLanguage } from "./first_words.ts";
import { parseView } from "./link.ts";
import { readBackground, readSeconds, readSpeed, readSwitch, readView } from "./values.ts";

/** `detail` of each event. */
export interface V3PlayerEventMap {
  "v3-opened": CustomEvent<{ readonly frameCount: number; readonly fps: number; readonly duration: number; readonly title: string | null }>;
  "v3-ready": CustomEvent<V3PlayerState>;
  "v3-play": CustomEvent<null>;
  "v3-pause": CustomEvent<null>;
  "v3-time": CustomEvent<{ readonly frame: number; readonly seconds: number }>;
  "v3-view": CustomEvent<View>;
  "v3-waiting": CustomEvent<boolean>;
  "v3-ended": CustomEvent<null>;
  "v3-looped": CustomEvent<null>;
  "v3-grown": CustomEvent<{ readonly frameCount: number; readonly duration: number; readonly live: boolean }>;
  "v3-sound": CustomEvent<{ readonly muted: boolean; readonly volume: number }>;
  "v3-intro-ended": CustomEvent<null>;
  "v3-updated": CustomEvent<null>;
  "v3-notice": CustomEvent<string>;
  "v3-error": CustomEvent<string>;
}

export interface V3PlayerState {
  readonly ready: boolean;
  readonly playing: boolean;
  readonly seconds: number;
  readonly duration: number;
  readonly frame: number;
  readonly frameCount: number;
  readonly speed: number;
  readonly loop: boolean;
  readonly live: boolean;
  /** null without sound. */
  readonly muted: boolean | null;
  /** null before the stream is open. */
  readonly view: View | null;
}

const TEXTS = ["src", "poster", "preload", "background", "view", "intro", "decoder"] as const;
const SWITCHES = ["autoplay", "loop", "muted", "controls", "page", "allowSrc"] as const;

/** Properties that reflect attributes: as a framework sets them, or in markup. */
export type V3PlayerProperties = Record<(typeof TEXTS)[number], string> & Record<(typeof SWITCHES)[number], boolean>;

/** Handlers of the events in JSX. */
export type V3PlayerHandlers = { readonly [K in keyof V3PlayerEventMap as `on${K}`]?: (event: V3PlayerEventMap[K]) => void };

declare global {
  interface HTMLElementTagNameMap {
    "v3-player": V3PlayerElement;
  }
  // eslint-disable-next-line @typescript-eslint/no-empty-object-type
  interface HTMLElementEventMap extends V3PlayerEventMap {}
}

/** Files of a stream in this page: base64 in script elements below the element that `selector` names. */
function embeddedFiles(selector: string): EmbeddedFiles {
  const scripts = document.querySelectorAll<HTMLElement>(`${selector} script[data-v3-file]`);
  return Object.fromEntries(Array.from(scripts, (script) => [script.dataset["v3File"]!, script.textContent]));
}

const reducesMotion = (): boolean => matchMedia("(prefers-reduced-motion: reduce)").matches;

// Where pages are rendered on a server, there are no elements, but the module can be imported.
const Base = (globalThis as Partial<typeof globalThis>).HTMLElement ?? (Object as unknown as typeof HTMLElement);

// The properties are defined below the class.
// eslint-disable-next-line @typescript-eslint/no-unsafe-declaration-merging, @typescript-eslint/no-empty-object-type
export interface V3PlayerElement extends V3PlayerProperties {}

// eslint-disable-next-line @typescript-eslint/no-unsafe-declaration-merging
export class V3PlayerElement extends Base implements ControlsHost, Tenant {
  static readonly observedAttributes = ["src", "poster", "preload", "background", "loop", "muted", "view", "decoder", "data-description"];

  readonly #root: ShadowRoot;
  #engine: Player | null = null;
  #ui: Controls | null = null;
  #unwatch: (() => void) | null = null;
  #seen = false;
  #isReady = false;
  #wantsToPlay = false;
  /** The time and view to begin with: a link's, or those before the context was given to another player. */
  #startAt: number | null = null;
  #startView: PartialView | null = null;
  #speed = 1;
  #file: File | null = null;
  #notices: string[] = [];
  /** Stops the intro that is flown. */
  #stopIntro: (() => void) | null = null;
  #introWanted = false;

  constructor() {
    super();
    this.#root = this.attachShadow({ mode: "open" });
    this.#root.addEventListener("click", (event) => {
      const act = (event.target as Element).closest<HTMLElement>("button")?.dataset["act"];
      if (act === "again") this.open(this.#file);
      // Until there are controls, which distinguish a tap from a turn.
      if (act === "start" && this.#ui === null) this.play();
    });
  }

  connectedCallback(): void {
    // Set before the element was defined, they hide those of the class.
    for (const name of [...TEXTS, ...SWITCHES]) {
      if (!Object.hasOwn(this, name)) continue;
      const value = this[name];
      Reflect.deleteProperty(this, name);
      (this as Record<string, unknown>)[name] = value;
    }
    if (this.#unwatch !== null) return; // it was only moved
    this.#build();
    this.#unwatch = watch(this, (seen) => this.#see(seen));
    if (this.page) this.#see(true);
    else this.#consider();
  }

  disconnectedCallback(): void {
    queueMicrotask(() => {
      if (this.isConnected) return; // it was moved
      this.#unwatch?.();
      this.#unwatch = null;
      this.#seen = false;
      this.#end();
    });
  }

  attributeChangedCallback(name: string, before: string | null, now: string | null): void {
    if (before === now || this.#unwatch === null) return;
    const engine = this.#engine;
    const info = engine?.info;
    if (name === "src") this.open();
    else if (name === "decoder" && this.#engine !== null) {
      this.#end();
      this.#begin(true);
    } else if (name === "background") this.#paint();
    else if (name === "loop" && this.#engine !== null) {
      this.#engine.loop = this.loop;
      this.#ui?.showChoices();
    } else if (name === "muted" && engine !== null) engine.muted = this.muted;
    else if (name === "view" && info && parseView(now) !== null) this.setView(now!);
    else this.#showPoster();
    this.#consider();
  }

  // Public interface --------------------------------------------------------------------------------------------------

  play(): void {
    this.#wantsToPlay = true;
    if (this.#engine === null) this.#begin(true);
    else this.#engine.play();
  }

  pause(): void {
    this.#wantsToPlay = false;
    this.#engine?.pause();
  }

  /** Seeks to a time in seconds; before the first frame or after the last, to that frame. RangeError: not a finite number. */
  seek(seconds: number): void {
    readSeconds(seconds);
    const { info } = this.#engine ?? {};
    if (!info) this.#startAt = seconds;
    else if (this.#ui === null) this.#engine!.seek(seconds);
    else this.#ui.timeline.seek(Math.floor(seconds * info.fps + 1e-6));
  }

  /** Goes to the newest group of a live stream. */
  seekLive(): void {
    this.#engine?.seekLive();
  }

  /** Sets the view; see `state.view`. What is missing stays as it is. `view`: an object, or text as in links. RangeError: not
   * a view. */
  setView(view: PartialView | string): void {
    const given = readView(view);
    this.endIntro();
    if (this.#engine?.info) this.#engine.view = given;
    else this.#startView = { ...this.#startView, ...given };
  }

  /** Goes back to the initial view. */
  resetView(): void {
    this.endIntro();
    if (!this.#engine?.info) this.#startView = null;
    else if (this.#ui === null) this.#engine.camera.reset();
    else this.#ui.motion.reset();
  }

  /** Sets the playback speed, 0.1 to 4; 1 is that of the recording. RangeError: not such a number. */
  setSpeed(speed: number): void {
    this.#speed = readSpeed(speed);
    if (this.#engine !== null) this.#engine.speed = this.#speed;
    this.#ui?.showChoices();
  }

  /** Whether playback starts over at the end: the attribute `loop`. */
  setLoop(loop: boolean): void {
    this.loop = readSwitch(loop, "setLoop");
  }

  /** Sets the background, the attribute `background`: a name as in the URL parameters. RangeError: another name. */
  setBackground(name: BackgroundName): void {
    this.background = readBackground(name);
  }

  /** Turns the sound off or on. Browsers may refuse to turn it on before the viewer has touched the page. */
  setMuted(muted: boolean): void {
    this.muted = readSwitch(muted, "setMuted");
    if (this.#engine !== null) this.#engine.muted = muted;
  }

  /** Opens a stream in one file (`.v3s`) on this computer. */
  openFile(file: File): void {
    this.open(file);
  }

  /** The state, which is also sent to a page that embeds the player in an iframe. */
  get state(): V3PlayerState {
    const player = this.#engine;
    return {
      ready: this.#isReady,
      playing: this.playing,
      seconds: player?.info ? player.seconds : (this.#startAt ?? 0),
      duration: player?.duration ?? 0,
      frame: player?.frame ?? 0,
      frameCount: player?.info?.frameCount ?? 0,
      speed: this.#speed,
      loop: this.loop,
      live: player?.info?.live ?? false,
      muted: player?.info?.hasSound === true ? player.muted : null,
      view: player?.info ? player.view : null,
    };
  }

  // For this package and its tests; not part of the stable interface --------------------------------------------------

  /** The player without controls; null while it does not draw. */
  get engine(): Player | null {
    return this.#engine;
  }

  /** The controls, once they are loaded. */
  get ui(): Controls | null {
    return this.#ui;
  }

  get seen(): boolean {
    return this.#seen;
  }

  get playing(): boolean {
    return this.#engine?.playing ?? false;
  }

  retire(): void {
    const picture = this.#engine?.snapshot() ?? null;
    this.#end();
    if (picture !== null) this.#showPoster(picture);
  }

  admit(): void {
    this.#consider();
  }

  notice(message: string): void {
    if (this.#ui === null) this.#notices.push(message);
    else this.#ui.notice(message);
  }

  busy(busy: boolean): void {
    this.#find(".veil").classList.toggle("busy", busy);
  }

  /** Opens the stream of the attribute `src`, or a stream in one file. */
  open(file: File | null = null): void {
    this.#file = file;
    if (this.#unwatch === null) return; // it begins once it is in the page
    const source = this.src;
    this.#find(".failure").hidden = true;
    const engine = this.#engine;
    if (engine === null) {
      this.#consider();
      return;
    }
    if (file === null && source === "") return;
    this.#isReady = false;
    this.#introWanted = this.intro !== "" && !reducesMotion();
    this.busy(true);
    this.#find(".poster").classList.remove("gone");
    this.#wantsToPlay ||= this.autoplay && !reducesMotion();
    try {
      void engine.open(file ?? (source.startsWith("#") ? embeddedFiles(source) : source));
    } catch (error) {
      this.#fail(`The address "${source}" cannot be opened: ${messageOf(error).replace(/\.$/, "")}.`);
    }
  }

  /** Opens what has taken the stream's place, at the same time and view. */
  openUpdated(): void {
    this.#keep();
    this.open();
  }

  endIntro(): void {
    this.#introWanted = false;
    if (this.#stopIntro === null) return;
    this.#stopIntro();
    this.#stopIntro = null;
    this.#tell("v3-intro-ended", null);
  }

  // Implementation ----------------------------------------------------------------------------------------------------

  #find(selector: string): HTMLElement {
    return this.#root.querySelector<HTMLElement>(selector)!;
  }

  #tell<K extends keyof V3PlayerEventMap>(event: K, detail: V3PlayerEventMap[K]["detail"]): void {
    this.dispatchEvent(new CustomEvent(event, { detail, bubbles: true, composed: true }));
  }

  #build(): void {
    const language = languageOf(this);
    this.#root.innerHTML = firstTemplate(language);
    setLanguage(this.#root, language);
    this.#root.adoptedStyleSheets = [];
    addStyle(this.#root, css);
    this.#showPoster();
  }

  #see(seen: boolean): void {
    this.#seen = seen;
    if (this.#engine !== null) this.#engine.hidden = !seen && !this.page;
    this.#consider();
  }

  #mayBegin(): boolean {
    if (this.#file !== null) return true;
    if (this.src === "") return false;
    const asked = this.#wantsToPlay || this.page || this.autoplay || !["none", "poster"].includes(this.preload);
    return asked && (this.#seen || this.page || this.#wantsToPlay);
  }

  /** Begins to draw if it is time. */
  #consider(): void {
    if (this.#unwatch === null || this.#engine !== null || !this.#find(".failure").hidden) return;
    if (this.#mayBegin()) this.#begin(this.#wantsToPlay || this.#file !== null);
    else this.#find(".start").hidden = this.src === "";
  }

  /** Takes a graphics context and opens the stream. */
  #begin(urgent: boolean): void {
    if (this.#unwatch === null || this.#engine !== null) return;
    const admitted = claim(this, urgent);
    this.#find(".start").hidden = admitted;
    if (!admitted) return;
    this.#showPoster();
    const { decoder } = this;
    try {
      this.#engine = new Player(this.#root.querySelector("canvas")!, { loop: this.loop, path: isDecoder(decoder) ? decoder : "auto" });
    } catch (error) {
      release(this);
      // Scripts that follow may want to listen first.
      setTimeout(() => this.#fail(messageOf(error)));
      return;
    }
    this.#engine.hidden = !this.#seen && !this.page;
    this.#engine.speed = this.#speed;
    this.#engine.muted = this.muted;
    this.#announce(this.#engine);
    this.#paint();
    this.open(this.#file);
  }

  /** Gives the graphics context and all else back; time, view and the rest are kept for the next time. */
  #end(): void {
    release(this);
    if (this.#engine === null) return;
    this.#keep();
    this.#stopIntro?.();
    this.#stopIntro = null;
    this.#engine.dispose();
    this.#engine = this.#ui = null;
    this.#isReady = false;
    this.classList.remove("begun", "idle");
    this.#build();
  }

  #keep(): void {
    const engine = this.#engine;
    if (!engine?.info) return;
    this.#startAt = engine.seconds;
    this.#startView = engine.view;
    this.#wantsToPlay = engine.playing;
  }

  /** Shows the background that is chosen. */
  #paint(): void {
    const engine = this.#engine;
    if (engine === null) return;
    const name = isBackground(this.background) ? this.background : "set";
    engine.showsSet = name === "set";
    const color = name === "stream" || name === "set" ? (engine.info?.background ?? BACKGROUNDS.black.color) : BACKGROUNDS[name].color;
    engine.background = color;
    this.style.backgroundColor = cssColor(color);
    this.classList.toggle("light", isLight(color ?? backdropOf(this)));
    this.#ui?.showChoices();
  }

  /** @param picture - of the frame that was shown, instead of the poster */
  #showPoster(picture?: string): void {
    this.#find("#about").textContent = this.getAttribute("data-description") ?? "";
    const image = this.#root.querySelector<HTMLImageElement>(".poster img")!;
    const address = picture ?? this.poster;
    image.hidden = address === "" || (this.preload === "none" && picture === undefined && !this.#mayBegin());
    if (image.hidden || image.getAttribute("src") === address) return;
    image.loading = this.page ? "eager" : "lazy";
    image.src = address;
  }

  /** Loads the controls, once for each context. */
  async #addControls(player: Player): Promise<void> {
    let rest: typeof import("./rest.ts");
    try {
      rest = await import("./rest.ts");
    } catch {
      this.#tell("v3-notice", "The controls did not arrive. Check the connection, then reload the page.");
      return;
    }
    if (player !== this.#engine || this.#ui !== null) return;
    this.#ui = rest.addControls(this, this.#root, player);
    for (const message of this.#notices.splice(0)) this.#ui.notice(message);
    this.dispatchEvent(new Event("v3-controls")); // for the review; not part of the stable interface
  }

  /** Dispatches the player's events as those of the element. */
  #announce(player: Player): void {
    player.on("opened", (info) => {
      this.#introWanted &&= this.#startView === null && this.#startAt === null;
      player.isMoment = this.#startAt !== null;
      const first = parseView(this.view);
      if (first !== null) player.camera.begin(first);
      if (this.#startView !== null) player.view = this.#startView;
      if (this.#startAt !== null) player.seek(this.#startAt);
      this.#startView = this.#startAt = null;
      this.#paint();
      this.#tell("v3-opened", { frameCount: info.frameCount, fps: info.fps, duration: player.duration, title: info.title });
    });
    player.on("ready", () => {
      this.#isReady = true;
      performance.mark("v3-first-image");
      this.busy(false);
      this.#find(".poster").classList.add("gone");
      this.classList.add("begun");
      if (this.#wantsToPlay) player.play();
      this.#tell("v3-ready", this.state);
      void this.#addControls(player).then(() => this.#introduce(player));
    });
    for (const name of ["play", "pause", "ended", "looped"] as const) player.on(name, () => this.#tell(`v3-${name}`, null));
    player.on("view", (view) => this.#tell("v3-view", view));
    player.on("waiting", (waiting) => {
      this.busy(waiting);
      this.#tell("v3-waiting", waiting);
    });
    player.on("notice", (message) => {
      this.notice(message);
      this.#tell("v3-notice", message);
    });
    player.on("frame", (detail) => this.#tell("v3-time", detail));
    player.on("grown", ({ frameCount, live }) => this.#tell("v3-grown", { frameCount, duration: player.duration, live }));
    player.on("sound", () => this.#tell("v3-sound", { muted: player.muted, volume: player.sound?.element.volume ?? 1 }));
    player.on("updated", () => {
      this.#tell("v3-updated", null);
      // Before the first image, there is nothing to be kept.
      if (!this.#isReady) this.openUpdated();
    });
    player.on("failed", (message) => this.#fail(message));
  }

  /** Flies the attribute's camera path, unless a link asks for a view or the viewer has moved the camera meanwhile. */
  async #introduce(player: Player): Promise<void> {
    const wanted = (): boolean => this.#introWanted && player === this.#engine;
    if (!wanted()) return;
    try {
      const { flyPath, loadPath } = await import("./rest.ts");
      const path = await loadPath(this.intro, player);
      if (wanted()) this.#stopIntro = flyPath(player, path, () => this.endIntro());
    } catch (error) {
      this.notice(messageOf(error));
    }
    this.#introWanted = false;
  }

  /** Says why nothing can be played, over the poster if there is one. */
  #fail(message: string): void {
    this.busy(false);
    const why = this.#find(".why");
    why.textContent = message;
    const language = languageOf(this);
    if (language !== "en")
      import("./rest.ts").then(({ inLanguage }) => (why.textContent = inLanguage(message, language)), () => undefined);
    this.#find(".failure").hidden = false;
    this.#tell("v3-error", message);
  }
}

function define(name: keyof V3PlayerProperties, property: ThisType<V3PlayerElement> & PropertyDescriptor): void {
  Object.defineProperty(V3PlayerElement.prototype, name, { configurable: true, enumerable: true, ...property });
}
for (const name of TEXTS)
  define(name, {
    get() {
      return this.getAttribute(name) ?? "";
    },
    set(value: unknown) {
      if (value === null || value === undefined) this.removeAttribute(name);
      else this.setAttribute(name, value as string);
    },
  });
for (const name of SWITCHES) {
  const attribute = name === "allowSrc" ? "allow-src" : name;
  define(name, {
    get() {
      return this.hasAttribute(attribute);
    },
    set(value: unknown) {
      this.toggleAttribute(attribute, Boolean(value));
    },
  });
}
