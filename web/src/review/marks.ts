/** The list of marks, and the form that adds, changes and removes them. */

import { messageOf } from "../stream/errors.ts";
import type { Player } from "../player/player.ts";
import { clock } from "../ui/format.ts";
import { type Mark, type MarkContent, type MarkView, Refused, type ReviewServer } from "./api.ts";
import { make, remembered } from "../ui/dom.ts";
import type { Pins } from "../ui/pins.ts";
import type { Comparison } from "./comparison.ts";
import { WORDS } from "./language.ts";
import type { Plots } from "./plots.ts";

const POLL = 4000; // milliseconds between two looks at what others have marked
const NAME_KEY = "v3-review-name";
const [MAX_NOTE, MAX_NAME] = [2000, 80];

const contentOf = ({ note, author, view }: Mark): MarkContent => ({ note, author, view });

/** A view without what depends on the shape of the window. */
const place = (view: MarkView): string => JSON.stringify({ ...view, fov: 0 });

/** Keeps the page above a phone's keyboard while something is written. Safari lays the keyboard over the page; browsers that
 * know `interactive-widget=resizes-content` make the page smaller themselves. */
const fit = (): void => {
  const { visualViewport: seen, document: { body } } = window;
  // Not while the viewer has zoomed in.
  if (seen === null || seen.scale > 1.01) return;
  body.style.height = `${seen.height}px`;
  window.scrollTo(0, 0);
};

export class Marks {
  readonly element = make("div", { class: "marks" });
  private readonly list = make("ol");
  /** The button that opens the form. */
  readonly add = make("button", { type: "button", class: "add" }, WORDS.mark);
  readonly form = make("form", { hidden: "" });
  private readonly heading = make("label", { for: "v3-review-note" });
  private readonly note = make("textarea", { id: "v3-review-note", rows: "2", maxlength: String(MAX_NOTE), placeholder: WORDS.note });
  private readonly author = make("input", { maxlength: String(MAX_NAME), placeholder: WORDS.name, "aria-label": WORDS.name, autocomplete: "name", enterkeyhint: "done" });
  private readonly remove = make("button", { type: "button" }, WORDS.remove);
  private readonly save = make("button", { type: "submit", class: "add" }, WORDS.save);
  /** A sentence that says what went wrong. */
  readonly problem = make("p", { class: "problem trouble", role: "alert" });
  private marks: readonly Mark[] = [];
  private editing: { frame: number; replaces: MarkContent | null } | null = null;
  private began: MarkView | null = null; // the view when the form was opened, which may have changed the image's shape
  private kept: MarkView | null = null; // the view of the mark that was gone to for editing

  /** `seek`: pauses at a frame. */
  constructor(
    private readonly server: ReviewServer,
    private readonly fps: number,
    private readonly player: Player,
    private readonly comparison: Comparison,
    private readonly plots: Plots,
    private readonly pins: Pins,
    private readonly seek: (frame: number) => void,
  ) {
    const cancel = make("button", { type: "button" }, WORDS.cancel);
    const kept = make("small", {}, WORDS.point);
    this.form.append(
      make("div", { class: "row" }, this.heading, kept, this.remove),
      this.note,
      make("div", { class: "row" }, this.author, this.save, cancel),
    );
    this.element.append(this.list);
    this.add.addEventListener("click", () => this.begin());
    cancel.addEventListener("click", () => this.close());
    this.form.addEventListener("submit", (event) => {
      event.preventDefault();
      const author = this.author.value.trim();
      remembered(NAME_KEY, author);
      void this.send({ note: this.note.value, author, view: { ...this.view(), place: this.pins.chosen } });
    });
    this.note.addEventListener("keydown", (event) => {
      if (event.key === "Enter" && !event.shiftKey) {
        event.preventDefault();
        this.form.requestSubmit();
      }
      if (event.key === "Escape") this.close();
    });
    this.remove.addEventListener("click", () => void this.send(null));
    void this.poll();
  }

  private async poll(): Promise<void> {
    for (;;) {
      if (document.visibilityState === "visible") {
        try {
          const marks = await this.server.marks();
          if (marks !== null) this.show(marks);
          if (this.editing === null) this.problem.textContent = "";
        } catch (error) {
          this.problem.textContent = WORDS.unreadable(messageOf(error));
        }
      }
      await new Promise((resolve) => setTimeout(resolve, POLL));
    }
  }

  /** Opens the form for the frame on the screen. */
  begin(): void {
    if (this.unsaved()) return;
    const { frame } = this.player;
    this.seek(frame);
    this.edit(frame, this.marks.find((one) => one.frame === frame), null);
  }

  /** Whether there is a note that another one would replace; goes back to it. */
  private unsaved(): boolean {
    if (this.editing === null || this.note.value === (this.editing.replaces?.note ?? "")) return false;
    this.problem.textContent = WORDS.finish;
    this.note.focus();
    return true;
  }

  private edit(frame: number, mark: Mark | undefined, kept: MarkView | null): void {
    this.kept = kept;
    this.editing = { frame, replaces: mark === undefined ? null : contentOf(mark) };
    this.began = this.comparison.view;
    this.heading.textContent = WORDS.noteOn(frame);
    this.note.value = mark?.note ?? "";
    this.author.value = remembered(NAME_KEY);
    this.remove.hidden = mark === undefined;
    this.problem.textContent = "";
    this.form.hidden = false;
    this.add.hidden = true;
    this.pins.begin(mark?.view?.place ?? null);
    this.setWriting(true);
    this.note.focus();
  }

  /** The view on the screen, or that of the mark that was gone to, if nobody has moved since. */
  private view(): MarkView {
    const now = this.comparison.view;
    if (this.began === null || place(now) !== place(this.began)) return now;
    return this.kept ?? this.began;
  }

  private close(): void {
    this.editing = null;
    this.form.hidden = true;
    this.add.hidden = false;
    this.pins.end();
    this.setWriting(false);
    this.problem.textContent = "";
  }

  /** Makes room for the form. */
  private setWriting(writing: boolean): void {
    this.form.parentElement?.classList.toggle("writing", writing);
    for (const name of ["resize", "scroll"] as const)
      if (writing) window.visualViewport?.addEventListener(name, fit);
      else window.visualViewport?.removeEventListener(name, fit);
    if (writing) fit();
    else document.body.style.height = "";
  }

  private async send(mark: MarkContent | null): Promise<void> {
    const { editing } = this;
    if (editing === null) return;
    this.save.disabled = this.remove.disabled = true;
    try {
      this.show(await this.server.change({ ...editing, mark }));
      this.close();
    } catch (error) {
      this.problem.textContent = error instanceof Refused ? error.message : WORDS.notSaved(messageOf(error));
      if (error instanceof Refused && error.marks !== null) this.refused(editing.frame, error.marks);
    } finally {
      this.save.disabled = this.remove.disabled = false;
    }
  }

  /** Somebody else changed the same mark: what was typed stays, and saving again replaces theirs. */
  private refused(frame: number, marks: readonly Mark[]): void {
    this.show(marks);
    const now = marks.find((one) => one.frame === frame);
    this.editing = { frame, replaces: now === undefined ? null : contentOf(now) };
    this.remove.hidden = now === undefined;
    const theirs = now === undefined ? WORDS.removed : WORDS.changed(now.note, now.author);
    this.problem.append(` ${theirs} ${WORDS.replace}`);
  }

  private show(marks: readonly Mark[]): void {
    this.marks = marks;
    const goTo = ({ frame, view }: Mark): void => {
      this.seek(frame);
      if (view !== null) this.comparison.go(view);
    };
    this.plots.mark(marks, goTo);
    this.pins.show(marks);
    this.list.replaceChildren(
      ...marks.map((mark) => {
        const go = make("button", { type: "button", class: "go" }, make("b", {}, `${mark.frame}`), ` ${clock(mark.frame / this.fps)}`);
        go.setAttribute("aria-label", WORDS.goTo(mark.frame));
        go.addEventListener("click", () => goTo(mark));
        const text = make("span", { class: "note" }, mark.note === "" ? WORDS.noNote : mark.note);
        if (mark.author !== "") text.append(make("small", {}, ` ${mark.author}`));
        const change = make("button", { type: "button", "aria-label": WORDS.editMark(mark.frame) }, WORDS.edit);
        change.addEventListener("click", () => {
          if (this.unsaved()) return;
          goTo(mark);
          this.edit(mark.frame, mark, mark.view);
        });
        return make("li", {}, go, text, change);
      }),
    );
  }
}
