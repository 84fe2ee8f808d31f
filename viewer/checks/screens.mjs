// The service's page on screens of many sizes, on a machine whose frames come late, and opened by addresses that hold a
// sentence; prints what it sees as JSON. `CHROMIUM=... node screens.mjs ADDRESS [OUT]` also writes a picture of each size.

import { join } from 'node:path';
import { frame, launch, pause, seek, shown, watched } from './browser.mjs';

const SIZES = [
  [320, 568], [360, 640], [640, 360], [390, 844], [844, 390], [768, 1024], [1024, 768], [1024, 500], [500, 1024], [1280, 720], [720, 1280], [1440, 900], [2560, 1440],
];
const [address, out] = process.argv.slice(2);
const browser = await launch();
const result = { screens: {}, faults: [] };
const open = async (options, search = '') => {
  const { page, faults } = await watched(browser, { reducedMotion: 'reduce', ...options });
  result.faults = [...result.faults, faults];
  await page.goto(address + search);
  await shown(page, 1);
  return page;
};
const signs = (page) => page.locator('#spans .sign button').allTextContents();

/** What is wrong with the page's layout, in lines; runs in the page. */
function wrong() {
  const faults = [];
  const name = (element) => element.id || element.dataset.view || element.dataset.file || element.textContent.trim().slice(0, 30);
  const all = [...document.querySelectorAll('button, select, summary, input:not([type=file])')];
  const controls = all.filter((element) => element.checkVisibility() && element.getClientRects().length);
  /** The part of a control that takes clicks: that of its label too, less what its parents cut off. */
  const target = (element) => {
    const { left, top, right, bottom } = (element.type === 'checkbox' ? element.closest('label') : element).getBoundingClientRect();
    const box = { left, top, right, bottom };
    for (let parent = element.parentElement; parent !== document.body; parent = parent.parentElement) {
      if (getComputedStyle(parent).overflow === 'visible') continue;
      const cut = parent.getBoundingClientRect();
      Object.assign(box, { left: Math.max(box.left, cut.left), top: Math.max(box.top, cut.top) });
      Object.assign(box, { right: Math.min(box.right, cut.right), bottom: Math.min(box.bottom, cut.bottom) });
    }
    return box;
  };
  const meet = (a, b) => Math.min(a.right, b.right) - Math.max(a.left, b.left) > 0.5 && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 0.5;
  const isHit = (element) => {
    const { left, top, right, bottom } = target(element);
    const hit = document.elementFromPoint((left + right) / 2, (top + bottom) / 2);
    return hit !== null && (element.contains(hit) || (element.type === 'checkbox' && element.closest('label').contains(hit)));
  };
  for (const y of [0, document.documentElement.scrollHeight]) {
    scrollTo(0, y);
    const stage = document.querySelector('#stage').getBoundingClientRect();
    const boxes = controls.map(target);
    boxes.forEach((box, k) => {
      if (meet(box, stage)) faults.push(`${name(controls[k])} is over the signer`);
      for (let n = 0; n < k; n++) if (meet(box, boxes[n])) faults.push(`${name(controls[k])} is over ${name(controls[n])}`);
    });
    if (y) continue;
    if (stage.top < 0 || stage.bottom > innerHeight || stage.height < 180 || stage.width < 240) faults.push(`signer in ${JSON.stringify(stage)}`);
    for (const id of ['play', 'frame', 'glosses']) if (!isHit(document.getElementById(id))) faults.push(`${id} cannot be clicked at once`);
  }
  if (document.documentElement.scrollWidth > innerWidth) faults.push('the page scrolls sideways');
  for (const control of controls) {
    control.scrollIntoView({ block: 'center', inline: 'center' });
    if (!isHit(control)) faults.push(`${name(control)} cannot be clicked`);
    const { width, height } = (control.type === 'checkbox' ? control.closest('label') : control).getBoundingClientRect();
    // A short sign's button may be narrow: the slider, the list of loops and the table of seams do the same.
    const isNarrow = width < 24 && !control.closest('#spans');
    if (isNarrow || height < (matchMedia('(pointer: coarse)').matches ? 43.9 : 24)) faults.push(`${name(control)} is ${width} x ${height}`);
  }
  scrollTo(0, 0);
  const status = document.querySelector('#status');
  const lines = status.scrollHeight / parseFloat(getComputedStyle(status).lineHeight);
  if (lines > 1.5 || status.title !== status.textContent) faults.push(`the status has ${lines} lines, title ${status.title}`);
  return faults;
}

// Every size, for fingers and for a mouse.
const SENTENCE = '?s=HELLO+MY+NAME+fs-ANNA+THANK-YOU';
for (const hasTouch of [true, false]) {
  const page = await open({ hasTouch, isMobile: hasTouch, locale: hasTouch ? 'en-GB' : 'zh-CN' }, SENTENCE);
  await page.click('[data-view=front]');
  for (const [width, height] of SIZES) {
    await page.setViewportSize({ width, height });
    await seek(page, 25);
    result.screens[`${width}x${height} ${hasTouch ? 'touch' : 'mouse'}`] = await page.evaluate(wrong);
    if (out) {
      await page.evaluate(() => document.querySelector('#time').scrollTo(0, 0));
      await page.screenshot({ path: join(out, `${width}x${height}-${hasTouch ? 'touch' : 'mouse'}.png`) });
    }
  }
  if (hasTouch) {
    result.labels = await page.locator('#spans, #seams, #loop, #status').allTextContents();
    result.letterTitles = await page.locator('#spans [title]').evaluateAll((all) => all.map(({ title }) => title));
  }
  await page.context().close();
}

// Frames that come in time, or late, by the page's clock. What is drawn is counted: triangles of the picture by part, and
// parts of the shadow.
const watchClock = (step) => {
  let target = null;
  let now = performance.now();
  globalThis.drawn = { parts: [], shadows: 0 };
  globalThis.buffers = 0; // that the accelerator holds
  const { bindFramebuffer, createBuffer, deleteBuffer, drawElements } = WebGL2RenderingContext.prototype;
  const { requestAnimationFrame: request } = globalThis;
  Object.assign(WebGL2RenderingContext.prototype, {
    bindFramebuffer(kind, framebuffer) {
      target = framebuffer;
      bindFramebuffer.call(this, kind, framebuffer);
    },
    createBuffer() {
      globalThis.buffers++;
      return createBuffer.call(this);
    },
    deleteBuffer(buffer) {
      globalThis.buffers--;
      deleteBuffer.call(this, buffer);
    },
    drawElements(mode, count, ...more) {
      if (target) globalThis.drawn.shadows++;
      else globalThis.drawn.parts.push(count / 3);
      drawElements.call(this, mode, count, ...more);
    },
  });
  let shown = 0;
  globalThis.requestAnimationFrame = (act) =>
    request((time) => {
      if (time !== shown) now += 1000 * step; // all calls of one frame have one time
      shown = time;
      act(now);
    });
};
const drawnAt = async (page, number) => {
  await page.evaluate(() => (globalThis.drawn = { parts: [], shadows: 0 }));
  await seek(page, number);
  return page.evaluate(() => globalThis.drawn);
};
const LETTERS = [...'ABCFILOVWY'].map((letter) => `fs-${letter}`).join('+');
/** Which points of the picture have the colour of skin. */
const skinMask = (page) =>
  page.evaluate(() => {
    const pen = new OffscreenCanvas(100, 120).getContext('2d');
    pen.drawImage(globalThis.picture(), 0, 0, 100, 120);
    const { data } = pen.getImageData(0, 0, 100, 120);
    return Array.from({ length: 12_000 }, (_, k) => Number(data[4 * k] > data[4 * k + 2] + 30)).join('');
  });
/** The hands in each letter, near. */
const handshapes = async (page) => {
  const frames = await page.locator('#spans .sign').evaluateAll((signs) => {
    const percents = signs.map(({ style }) => parseFloat(style.left) + parseFloat(style.width) / 2);
    return percents.map((percent) => Math.round((percent / 100) * Number(document.querySelector('#frame').max)));
  });
  const masks = [];
  for (const number of frames) {
    await seek(page, number);
    await page.click('[data-view=hands]');
    await seek(page, number);
    masks.push(await skinMask(page));
  }
  return masks;
};
for (const [name, step] of Object.entries({ inTime: 0.045, late: 0.07, veryLate: 0.2 })) {
  const { page, faults } = await watched(browser, { reducedMotion: 'reduce', viewport: { width: 390, height: 600 }, deviceScaleFactor: 2 });
  result.faults.push(faults);
  await page.addInitScript(watchClock, step);
  await page.goto(`${address}?s=${name === 'veryLate' ? LETTERS : 'HELLO'}`);
  await shown(page, 1);
  const hands = name === 'veryLate' ? [await handshapes(page)] : [];
  const before = await drawnAt(page, 10);
  await page.selectOption('#loop', 'all');
  await page.evaluate(() => document.querySelector('#play').click());
  const wanted = { inTime: 0, late: 1, veryLate: 2 }[name];
  await page.evaluate(async ([seconds, detail]) => {
    const [start, canvas] = [performance.now(), globalThis.picture()];
    let n = 0;
    const enough = () => (detail ? Number(canvas.dataset.detail) >= detail : n >= seconds);
    while (!enough() && performance.now() - start < 300_000) await new Promise((done) => requestAnimationFrame(() => done(n++)));
  }, [Math.ceil(1.5 / step), wanted]);
  await pause(page);
  const ratio = await page.evaluate(() => globalThis.picture().width / globalThis.picture().clientWidth);
  result[name] = { before, after: await drawnAt(page, 10), ratio };
  if (name === 'veryLate') result.handshapes = [...hands, await handshapes(page)];
  if (out) await page.screenshot({ path: join(out, `${name}.png`) });
  if (name === 'late') {
    const held = await page.evaluate(() => globalThis.buffers);
    await page.fill('#glosses', 'MY');
    await page.keyboard.press('Enter');
    await shown(page, 2);
    result.lateAgain = await drawnAt(page, 10);
    result.buffers = [held, await page.evaluate(() => globalThis.buffers)];
  }
  await page.context().close();
}

// The hands preset is close.
const skin = (page) =>
  page.evaluate(() => {
    const pen = new OffscreenCanvas(200, 200).getContext('2d');
    pen.drawImage(globalThis.picture(), 0, 0, 200, 200);
    const { data } = pen.getImageData(0, 0, 200, 200);
    let n = 0;
    for (let k = 0; k < data.length; k += 4) if (data[k] > data[k + 2] + 30) n++;
    return n / 40_000;
  });
const shared = await open({ viewport: { width: 700, height: 700 } }, '?s=HELLO');
await seek(shared, 20);
result.skin = [await skin(shared)];
await shared.click('[data-view=hands]');
await seek(shared, 20);
result.skin.push(await skin(shared));
if (out) await shared.screenshot({ path: join(out, 'hands.png') });

// An address holds a sentence and what is set; back and forward show what was signed.
const search = () => shared.evaluate(() => location.search);
const state = async () => ({
  search: await search(),
  signs: await signs(shared),
  values: await Promise.all(['#glosses', '#sign-speed', '#speed', '#cutter', '#transition', '#transition-time', '#tempo', '#free-hand', '#person'].map((query) => shared.inputValue(query))),
  isAuto: await shared.isChecked('#transition-auto'),
  pressed: await shared.locator('[aria-pressed=true]').evaluateAll((all) => all.flatMap((one) => one.dataset.view || one.id || [])),
  title: await shared.title(),
});
const odd = encodeURIComponent('"><img src=x onerror="globalThis.hacked=1.5">');
await shared.goto(`${address}?s=DEAF+FRIEND&sign_speed=1.5&speed=0.5&transition=slerp&transition_time=0.4&view=side&mirror=1&captions=0&tempo=natural&free_hand=transition&person=0.5&cutter=${odd}`);
await shown(shared, 1);
result.opened = await state();
await shared.fill('#glosses', 'HELLO fs-AB');
await shared.keyboard.press('Enter');
await shown(shared, 2);
result.signed = await state();
await shared.locator('#transition-auto').check();
await shown(shared, 3);
await shared.evaluate(() => (location.hash = 'controls')); // a link within the page signs nothing anew
await shared.goBack();
result.unlinked = await shared.evaluate(() => document.querySelector('#stage').dataset.ready);
await shared.goBack();
await shown(shared, 4);
result.back = await state();
await shared.goForward();
await shown(shared, 5);
result.forward = await state();
await shared.reload();
await shown(shared, 1);
result.reloaded = await state();
await shared.goto(`${address}?s=${odd}&view=${odd}&sign_speed=1e99&transition_time=${odd}&speed=NaN&tempo=0.7&free_hand=${odd}&person=${odd}`);
await shown(shared, 1);
result.odd = { ...(await state()), hacked: await shared.evaluate(() => globalThis.hacked ?? null) };

await browser.close();
console.log(JSON.stringify(result, null, 1));
