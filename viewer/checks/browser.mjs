// A headless Chromium, and helpers to drive the viewer's page in it.

import { chromium } from 'playwright-core';

// The watchdog would end the software renderer on a loaded machine.
const FLAGS = [
  '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--disable-gpu-watchdog', '--no-sandbox',
];

export async function launch() {
  return chromium.launch({ executablePath: process.env.CHROMIUM, args: FLAGS });
}

/** A page, with its faults (console errors and warnings, thrown errors) and the hosts that it sends requests to. */
export async function watched(browser, options = {}) {
  const context = await browser.newContext({ acceptDownloads: true, locale: 'en-GB', ...options });
  const page = await context.newPage();
  await page.addInitScript(() => {
    globalThis.picture = () => (document.querySelector('sign-player')?.shadowRoot ?? document).querySelector('canvas');
  });
  const faults = [];
  const hosts = new Set();
  page.on('console', (message) => {
    if (['error', 'warning'].includes(message.type())) faults.push(`${message.type()}: ${message.text()}`);
  });
  page.on('pageerror', (error) => faults.push(`thrown: ${error.message}`));
  page.on('request', (request) => {
    const { protocol, host } = new URL(request.url());
    if (['http:', 'https:', 'ws:', 'wss:'].includes(protocol)) hosts.add(host);
  });
  page.setDefaultTimeout(Number(process.env.PATIENCE ?? 600_000)); // other processes may load the machine
  return { page, context, faults, hosts };
}

/** Wait until the page has shown ``times`` animations; then stop it, since drawing in software is slow, or let it ``run``. */
export async function shown(page, times, run = false) {
  await page.waitForFunction((n) => Number(document.querySelector('#stage').dataset.ready ?? 0) >= n, times);
  if (!run) await pause(page);
}

export const frame = (page) => page.evaluate(() => Number(document.querySelector('#frame').value));

/** The next frame that is shown after the current one. */
export async function nextFrame(page) {
  const now = await frame(page);
  await page.waitForFunction((value) => Number(document.querySelector('#frame').value) !== value, now);
  return frame(page);
}

/** Show a frame, and wait until it is drawn. */
export async function seek(page, number) {
  await page.evaluate((value) => {
    const slider = document.querySelector('#frame');
    slider.value = String(value);
    slider.dispatchEvent(new Event('input', { bubbles: true }));
  }, number);
  await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
}

/** Stop the animation at its current frame. */
export async function pause(page) {
  await page.evaluate(() => {
    const play = document.querySelector('#play');
    if (play.textContent !== '▶') play.click();
  });
}

/** Fraction of pixels that are not background, in the left and in the right half of the picture. */
export function drawn(page) {
  return page.evaluate(() => {
    const canvas = globalThis.picture();
    const copy = new OffscreenCanvas(160, 100);
    const pen = copy.getContext('2d');
    pen.drawImage(canvas, 0, 0, 160, 100);
    const { data } = pen.getImageData(0, 0, 160, 100);
    const counts = [0, 0];
    for (let k = 0; k < 160 * 100; k++) {
      const [r, g, b] = data.subarray(4 * k, 4 * k + 3);
      if (Math.abs(r - data[0]) + Math.abs(g - data[1]) + Math.abs(b - data[2]) > 24) counts[k % 160 < 80 ? 0 : 1]++;
    }
    return counts.map((count) => count / (80 * 100));
  });
}
