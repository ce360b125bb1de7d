/** Sound that starts over without a gap: the whole loop is in memory, and Web Audio plays it. Without Web Audio, before the
 * viewer's first input, for long loops and at other speeds, an <audio> element plays instead (sound.ts). */

export class LoopSound {
  private readonly context = new AudioContext();
  private readonly gain = this.context.createGain();
  private buffer: AudioBuffer | null = null;
  private source: AudioBufferSourceNode | null = null;
  /** When, on the context's clock, the loop on the screen has begun. */
  private began = 0;
  private closed = false;

  /** @param seconds - duration of the frames */
  constructor(file: Blob, start: number, private readonly seconds: number) {
    this.gain.connect(this.context.destination);
    // Else an iPhone's silent switch turns it off, unlike <audio>.
    const { audioSession } = navigator as { readonly audioSession?: { type: string } };
    if (audioSession !== undefined) audioSession.type = "playback";
    void this.decode(file, start).catch(() => undefined); // the element says what is wrong
  }

  private async decode(file: Blob, start: number): Promise<void> {
    const { context, seconds } = this;
    const sound = await context.decodeAudioData(await file.arrayBuffer());
    const buffer = context.createBuffer(sound.numberOfChannels, Math.ceil(seconds * sound.sampleRate) + 1, sound.sampleRate);
    const offset = Math.round(start * sound.sampleRate);
    for (let channel = 0; channel < sound.numberOfChannels; channel++)
      buffer.copyToChannel(sound.getChannelData(channel).subarray(0, buffer.length - offset), channel, offset);
    this.buffer = buffer;
  }

  get ready(): boolean {
    return this.buffer !== null && this.context.state === "running";
  }

  /** Within an input of the viewer, which browsers may require. */
  resume(): void {
    if (!this.closed) this.context.resume().catch(() => undefined);
  }

  set muted(muted: boolean) {
    this.gain.gain.value = muted ? 0 : 1;
  }

  /** Starts at a time of the stream, seconds. */
  play(at: number): void {
    this.halt();
    const source = (this.source = new AudioBufferSourceNode(this.context, { buffer: this.buffer, loop: true, loopEnd: this.seconds }));
    source.connect(this.gain);
    source.start(0, at);
    this.began = this.context.currentTime - at;
  }

  /** Seconds since the loop on the screen has begun; more than it has, once the next one is heard. */
  get time(): number {
    return this.context.currentTime - (this.context.outputLatency || 0) - this.began;
  }

  /** The next loop is on the screen. */
  lap(): void {
    this.began += this.seconds;
  }

  halt(): void {
    this.source?.stop();
    this.source?.disconnect();
    this.source = null;
  }

  dispose(): void {
    this.halt();
    this.closed = true;
    void this.context.close();
  }
}
