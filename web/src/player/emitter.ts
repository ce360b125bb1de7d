/** Events by name. */

type Handlers<Events> = { [K in keyof Events]?: ((value: Events[K]) => void)[] };

export class Emitter<Events> {
  private handlers: Handlers<Events> = {};

  on<K extends keyof Events>(event: K, handler: (value: Events[K]) => void): void {
    (this.handlers[event] ??= []).push(handler);
  }

  protected emit<K extends keyof Events>(event: K, value: Events[K]): void {
    for (const handler of this.handlers[event] ?? []) handler(value);
  }

  protected removeAll(): void {
    this.handlers = {};
  }
}
