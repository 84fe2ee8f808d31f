// What the page and the checks that drive it share: a headless Chromium, and a page that is watched.

import { chromium } from 'playwright-core';

const FLAGS = ['--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--no-sandbox'];

export async function launch() {
  return chromium.launch({ executablePath: process.env.CHROMIUM, args: FLAGS });
}

/** A page, and what goes wrong in it: console errors, thrown errors, requests to other hosts than its own. */
export async function watched(browser, options = {}) {
  const context = await browser.newContext({ acceptDownloads: true, locale: 'en-GB', ...options });
  const page = await context.newPage();
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
  page.setDefaultTimeout(90_000);
  return { page, context, faults, hosts };
}

/** Wait until the page has shown so many animations; it is stopped then, since software takes long to draw, or let run. */
export async function shown(page, times, run = false) {
  await page.waitForFunction((n) => Number(document.querySelector('#stage').dataset.ready ?? 0) >= n, times);
  if (!run) await pause(page);
}

export const frame = (page) => page.evaluate(() => Number(document.querySelector('#frame').value));

/** Another frame than the one that is shown now, as soon as there is one. */
export async function later(page) {
  const now = await frame(page);
  await page.waitForFunction((value) => Number(document.querySelector('#frame').value) !== value, now);
  return frame(page);
}

/** Put a frame before the eyes, and wait until it is drawn. */
export async function seek(page, at) {
  await page.evaluate((value) => {
    const slider = document.querySelector('#frame');
    slider.value = String(value);
    slider.dispatchEvent(new Event('input', { bubbles: true }));
  }, at);
  await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))));
}

/** Stop, wherever the animation is. */
export async function pause(page) {
  await page.evaluate(() => {
    const play = document.querySelector('#play');
    if (play.textContent !== '▶') play.click();
  });
}

/** Share of the picture's pixels, over its left or right half, that are not background. */
export function drawn(page) {
  return page.evaluate(() => {
    const canvas = document.querySelector('#stage canvas');
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
