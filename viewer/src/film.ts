/** Films: every frame of the animation is encoded once, however slow the machine is. */

import { BufferTarget, CanvasSource, Mp4OutputFormat, Output, QUALITY_HIGH, WebMOutputFormat } from 'mediabunny';
import { getFirstEncodableVideoCodec } from 'mediabunny';

export const SIZE = { width: 1920, height: 1080 };

export interface Film {
  bytes: ArrayBuffer;
  suffix: 'mp4' | 'webm';
}

/** Whether this browser can encode films on this page. */
export function possible(): boolean {
  return typeof VideoEncoder !== 'undefined';
}

/** Encode the frames that ``draw`` draws: H.264 in MP4 if the browser can, else VP9 or VP8 in WebM; null if neither. */
export async function film(
  frames: number,
  fps: number,
  draw: (canvas: CanvasRenderingContext2D, frame: number) => void,
  progress: (done: number) => void,
): Promise<Film | null> {
  const codec = await getFirstEncodableVideoCodec(['avc', 'vp9', 'vp8'], SIZE);
  if (!codec) return null;
  const canvas = Object.assign(document.createElement('canvas'), SIZE);
  const pen = canvas.getContext('2d', { alpha: false })!;
  const target = new BufferTarget();
  const mp4 = codec === 'avc';
  const output = new Output({ format: mp4 ? new Mp4OutputFormat() : new WebMOutputFormat(), target });
  const source = new CanvasSource(canvas, { codec, bitrate: QUALITY_HIGH });
  output.addVideoTrack(source, { frameRate: fps });
  await output.start();
  for (let frame = 0; frame < frames; frame++) {
    draw(pen, frame);
    await source.add(frame / fps, 1 / fps);
    progress(frame + 1);
  }
  await output.finalize();
  return { bytes: target.buffer!, suffix: mp4 ? 'mp4' : 'webm' };
}

/** Draw a caption as the page shows it, centred at ``x``; ``inTransition``: in the style of a transition. */
export function drawCaption(pen: CanvasRenderingContext2D, text: string, inTransition: boolean, x: number): void {
  if (!text) return;
  const { height } = SIZE;
  pen.font = `${inTransition ? 400 : 650} ${Math.round(height * 0.048)}px system-ui, sans-serif`;
  pen.textAlign = 'center';
  pen.textBaseline = 'middle';
  const wide = pen.measureText(text).width + height * 0.05;
  const [tall, y] = [height * 0.075, height * 0.925];
  pen.fillStyle = 'rgb(255 255 255 / .87)';
  pen.beginPath();
  pen.roundRect(x - wide / 2, y - tall / 2, wide, tall, height * 0.012);
  pen.fill();
  pen.fillStyle = inTransition ? '#3c4750' : '#10161b';
  pen.fillText(text, x, y);
}
