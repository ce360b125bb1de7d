/** The worker of the next player: it starts while the page prepares the rest. */

import workerSource from "worker-source";

let address: string | null = null;
let spare: Worker | null = null;

export function startWorker(): void {
  address ??= URL.createObjectURL(new Blob([workerSource], { type: "text/javascript" }));
  spare ??= new Worker(address);
}

export function takeWorker(): Worker {
  startWorker();
  const worker = spare!;
  spare = null;
  return worker;
}
