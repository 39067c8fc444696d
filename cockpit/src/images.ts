// Pictures of real or simulated cameras, as textures for the stereo view.

import { DataTexture, LinearFilter, RGBAFormat, SRGBColorSpace, Texture, UnsignedByteType } from "three";
import type { Connection, Message } from "./connection";
import { seconds } from "./messages";
import type { Eye, Stage } from "./stage";

/** Bytes per pixel of the encodings that are shown. */
const BYTES: Record<string, number> = { mono8: 1, "8UC1": 1, rgb8: 3, bgr8: 3, rgba8: 4, bgra8: 4 };
/** Largest picture that is shown [pixels]. */
const LARGEST = 1 << 24;

/** RGBA pixels, the lowest row first; an error for what cannot be shown. */
export function pixels(image: Message): Uint8Array<ArrayBuffer> {
  const { width, height, step, data, encoding } = image;
  const n = BYTES[encoding];
  if (n === undefined) throw new Error(`encoding ${encoding}; expected ${Object.keys(BYTES).join(", ")}`);
  if (width * height === 0 || width * height > LARGEST) throw new Error(`${width} x ${height} pixels`);
  if (step < width * n || data.length < step * (height - 1) + width * n) throw new Error(`${data.length} bytes, step ${step}`);
  const out = new Uint8Array(4 * width * height);
  const swapped = encoding.startsWith("bgr");
  for (let y = 0; y < height; y++) {
    let from = y * step;
    let to = 4 * width * (height - 1 - y);
    for (let x = 0; x < width; x++, from += n, to += 4) {
      const [a, b, c] = n === 1 ? [data[from], data[from], data[from]] : [data[from], data[from + 1], data[from + 2]];
      out[to] = swapped ? c : a;
      out[to + 1] = b;
      out[to + 2] = swapped ? a : c;
      out[to + 3] = 255;
    }
  }
  return out;
}

export class Images {
  /** Stamp of the last picture of each eye [s]. */
  readonly stamps: Partial<Record<Eye, number>> = {};
  /** Whether anybody's camera is a pair. */
  private paired = false;
  /** Eyes whose picture is being decoded, and the newest one that waits for it. */
  private readonly decoding = new Map<Eye, (() => void) | undefined>();

  /** Topics for which `isOther` is true are those of robots that are not shown. */
  constructor(private readonly connection: Connection, private readonly stage: Stage, isOther: (topic: string) => boolean) {
    const on = (topic: RegExp, handler: (message: Message) => void, but = (_: string) => false) =>
      connection.on((c) => topic.test(c.topic) && !isOther(c.topic) && !but(c.topic), handler);
    const isCompressed = (topic: string) => this.has(`${topic}/compressed`);
    for (const eye of ["left", "right"] as const) {
      const raw = new RegExp(`camera/${eye}/image(_raw|_color|_rect)?$`);
      const compressed = new RegExp(`camera/${eye}/image(_raw|_color|_rect)?/compressed$`);
      on(compressed, (m) => this.decode(m, [eye], true));
      on(raw, (m) => this.show(m, [eye], true), isCompressed);
    }
    // One camera is shown to both eyes.
    on(/camera\/image_raw\/compressed$/, (m) => this.decode(m, ["left", "right"], false));
    on(/camera\/image_raw$/, (m) => this.show(m, ["left", "right"], false), isCompressed);
  }

  private has(topic: string): boolean {
    return [...this.connection.channels.values()].some((c) => c.topic === topic);
  }

  private show(message: Message, eyes: Eye[], pair: boolean): void {
    this.paired ||= pair;
    if (this.paired && !pair) return;
    try {
      const { width, height } = message;
      const texture = new DataTexture(pixels(message), width, height, RGBAFormat, UnsignedByteType);
      this.put(texture, message, eyes);
    } catch (error) {
      this.connection.onNotice(`camera image: ${(error as Error).message}`);
    }
  }

  private decode(message: Message, eyes: Eye[], pair: boolean): void {
    this.paired ||= pair;
    if (this.paired && !pair) return;
    // Pictures that come faster than they are decoded are left out.
    const [eye] = eyes;
    if (this.decoding.has(eye)) {
      this.decoding.set(eye, () => this.decode(message, eyes, pair));
      return;
    }
    this.decoding.set(eye, undefined);
    const { session } = this.connection;
    const done = () => {
      const next = this.decoding.get(eye);
      this.decoding.delete(eye);
      if (session === this.connection.session) next?.();
    };
    const blob = new Blob([message.data], { type: message.format.includes("png") ? "image/png" : "image/jpeg" });
    createImageBitmap(blob, { imageOrientation: "flipY" }).then(
      (bitmap) => {
        // The picture of a connection that has ended.
        if (session !== this.connection.session) return bitmap.close();
        const texture = new Texture(bitmap);
        texture.flipY = false;
        this.put(texture, message, eyes);
      },
      () => this.connection.onNotice(`camera image: a compressed picture cannot be read (${message.format})`),
    ).finally(done);
  }

  private put(texture: Texture, message: Message, eyes: Eye[]): void {
    texture.colorSpace = SRGBColorSpace;
    texture.minFilter = texture.magFilter = LinearFilter;
    texture.generateMipmaps = false;
    texture.needsUpdate = true;
    const old = new Set(eyes.map((eye) => this.stage.pictures[eye]));
    for (const eye of eyes) {
      this.stage.pictures[eye] = texture;
      this.stamps[eye] = seconds(message.header.stamp);
    }
    for (const one of old) this.free(one);
  }

  private free(texture: Texture | undefined): void {
    if (!texture || Object.values(this.stage.pictures).includes(texture)) return;
    if (texture.image instanceof ImageBitmap) texture.image.close();
    texture.dispose();
  }

  clear(): void {
    for (const eye of ["left", "right"] as const) {
      const old = this.stage.pictures[eye];
      delete this.stage.pictures[eye];
      delete this.stamps[eye];
      this.free(old);
    }
    this.paired = false;
  }
}
