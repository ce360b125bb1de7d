/** The choice of the players of a page that may draw. Browsers keep 16 graphics contexts at most, some phones 8, and take the
 * oldest away: its canvas turns white. So a player that nobody sees gives its context to one that is seen, and shows a picture instead. */

const MOST = 8;

export interface Tenant {
  /** Whether it is on the screen, or near. */
  readonly seen: boolean;
  readonly playing: boolean;
  /** Gives its context back. */
  retire(): void;
  /** Called when a context is free that it has waited for. */
  admit(): void;
}

/** The players that draw, in the order in which they began. */
const tenants = new Set<Tenant>();
const waiting = new Set<Tenant>();

/** Makes room for one more. `urgent`: the viewer asks for it, so that one that is seen gives way, too. Returns whether there is
 * room; if not, `admit` is called later. */
export function claim(tenant: Tenant, urgent: boolean): boolean {
  const all = [...tenants];
  const last = urgent ? (all.find(({ playing }) => !playing) ?? all[0]) : undefined;
  const victim = tenants.size < MOST ? null : (all.find(({ seen }) => !seen) ?? last);
  if (victim === undefined) {
    waiting.add(tenant);
    return false;
  }
  if (victim !== null) {
    tenants.delete(victim);
    victim.retire();
  }
  waiting.delete(tenant);
  tenants.add(tenant);
  return true;
}

/** It draws no more, and does not wait. */
export function release(tenant: Tenant): void {
  waiting.delete(tenant);
  if (!tenants.delete(tenant)) return;
  const [next] = waiting;
  if ((next as Tenant | undefined) !== undefined) queueMicrotask(() => next.admit());
}

/** Calls `changed` when an element comes near to the screen, or leaves it. Returns what ends that. */
export function watch(element: Element, changed: (seen: boolean) => void): () => void {
  const observer = new IntersectionObserver((entries) => changed(entries.at(-1)!.isIntersecting), { rootMargin: "25%" });
  observer.observe(element);
  return () => observer.disconnect();
}
