/** The choice of the players of a page that may draw. Browsers keep 16 graphics contexts at most, some phones 8, and take the
 * oldest away: its canvas turns white. So a player that nobody sees gives its context to one that is seen, and shows a picture instead. */

const MOST = 8;

export interface Tenant {
  /** Whether it is on the screen, or near. */
  readonly seen: boolean;
  readonly playing: boolean;
  getBoundingClientRect(): DOMRect;
  /** Gives its context back. */
  retire(): void;
  /** Called when a context is free that it has waited for. */
  admit(): void;
}

/** The players that draw, in the order in which they began. */
const tenants = new Set<Tenant>();
const waiting = new Set<Tenant>();

function isVisible(tenant: Tenant): boolean {
  const { top, bottom, left, right } = tenant.getBoundingClientRect();
  return bottom > 0 && top < innerHeight && right > 0 && left < innerWidth;
}

/** Makes room for one more. `urgent`: the viewer asks for it, so that one that is seen gives way, too. Returns whether there is
 * room; if not, `admit` is called later. */
export function claim(tenant: Tenant, urgent: boolean): boolean {
  const all = [...tenants];
  const last = urgent ? (all.find(({ playing }) => !playing) ?? all[0]) : undefined;
  const victim = tenants.size < MOST ? null : (all.find(({ seen }) => !seen) ?? (isVisible(tenant) ? all.find((other) => !isVisible(other)) : undefined) ?? last);
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

/** Calls `changed` with whether an element is on the screen or near, when that changes, and when it comes onto the screen.
 * Returns what ends that. */
export function watch(element: Element, changed: (seen: boolean) => void): () => void {
  let near = false;
  const observers = ["25%", "0px"].map((rootMargin) => {
    const observer = new IntersectionObserver((entries) => {
      const { isIntersecting } = entries.at(-1)!;
      if (rootMargin !== "0px") near = isIntersecting;
      changed(near || isIntersecting);
    }, { rootMargin });
    observer.observe(element);
    return observer;
  });
  return () => observers.forEach((observer) => observer.disconnect());
}
