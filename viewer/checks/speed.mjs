// How many frames a second the page draws while it plays, in software GL: `CHROMIUM=... node speed.mjs ADDRESS [WIDTH HEIGHT
// RATIO SECONDS]`. It also prints the processor time that a frame costs in all of the browser's processes, ms: what else runs
// on the machine makes frames late, but leaves that time nearly as it is.

import { launch, watched } from './browser.mjs';

const [address, width = '390', height = '844', ratio = '1', seconds = '10'] = process.argv.slice(2);
const browser = await launch();
const viewport = { width: Number(width), height: Number(height) };
const { page } = await watched(browser, { viewport, deviceScaleFactor: Number(ratio) });
await page.goto(address);
await page.waitForFunction(() => document.querySelector('#stage').dataset.ready);
await page.selectOption('#loop', 'all');
await page.waitForTimeout(Number(process.env.WARM ?? 5000));
const session = await browser.newBrowserCDPSession();
const used = async () => (await session.send('SystemInfo.getProcessInfo')).processInfo.reduce((sum, { cpuTime }) => sum + cpuTime, 0);
const before = await used();
const measured = await page.evaluate(async (time) => {
  const play = document.querySelector('#play');
  if (play.textContent === '▶') play.click();
  const canvas = globalThis.picture();
  const start = performance.now();
  let frames = 0;
  await new Promise((done) => {
    const count = () => (performance.now() - start < time * 1000 ? (frames++, requestAnimationFrame(count)) : done());
    requestAnimationFrame(count);
  });
  return { frames, rate: (1000 * frames) / (performance.now() - start), detail: Number(canvas.dataset.detail ?? 0) };
}, Number(seconds));
measured.cpu_ms_per_frame = (1000 * ((await used()) - before)) / measured.frames;
await browser.close();
console.log(JSON.stringify({ viewport, ratio: Number(ratio), ...measured }));
