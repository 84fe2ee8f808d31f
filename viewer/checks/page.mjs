// Uses the service's page in a headless Chromium as a person would, and prints what it shows as JSON. Pictures and
// downloads are written to OUT. `CHROMIUM=... node page.mjs ADDRESS OUT A.bvh B.bvh AVATAR.vrm SHORT.bvh`

import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { basename, join } from 'node:path';
import { drawn, frame, launch, nextFrame, pause, seek, shown, watched } from './browser.mjs';

const [address, out, first, second, avatar, short] = process.argv.slice(2);
const SCREEN = { width: 900, height: 580 }; // small, since drawing in software is slow
const browser = await launch();
const result = {};
const { page, faults, hosts } = await watched(browser, { viewport: SCREEN });
const texts = (query) => page.locator(query).allTextContents();

// The page opens and signs.
await page.goto(address);
await shown(page, 1, true);
result.firstSigns = await texts('#spans .sign button');
result.playButton = await page.locator('#play').textContent();
result.drawn = await drawn(page);
result.running = [await frame(page), await nextFrame(page)];
await pause(page);

// Type a sentence, and complete a gloss in it.
await page.fill('#glosses', '');
await Promise.all([
  page.waitForResponse((answer) => answer.url().endsWith('search=thank')), // slow typing brings suggestions for less too
  page.locator('#glosses').pressSequentially('fs-AB thank', { delay: 15 }),
]);
await page.waitForSelector('#suggestions:not([hidden]) li:first-child[data-gloss=THANK-YOU]');
result.suggestions = await texts('#suggestions li');
await page.keyboard.press('ArrowDown');
result.activeSuggestion = await page.getAttribute('#glosses', 'aria-activedescendant');
await page.keyboard.press('Enter');
result.typed = await page.inputValue('#glosses');
await page.keyboard.press('Enter');
await shown(page, 2, true);
result.typedSigns = await texts('#spans .sign button');
result.typedPlayButton = await page.locator('#play').textContent();
await pause(page);
await seek(page, 2);
result.caption = await page.locator('.caption').first().textContent();
result.letter = await texts('.caption b');

// A line without a sign gives an error, and the sentence before stays.
await page.fill('#glosses', '你好');
await page.keyboard.press('Enter');
await page.waitForSelector('#alert:not([hidden])');
result.unknown = await page.locator('#alert').textContent();
result.expectedFaults = faults.splice(0); // the browser reports the 422 too
result.keptSigns = await texts('#spans .sign button');

// Drop two files.
const drop = (paths) =>
  page.evaluate(
    (files) => {
      const transfer = new DataTransfer();
      for (const { name, base64 } of files) {
        const bytes = Uint8Array.from(atob(base64), (character) => character.charCodeAt(0));
        transfer.items.add(new File([bytes], name));
      }
      for (const type of ['dragenter', 'dragover', 'drop']) {
        document.body.dispatchEvent(new DragEvent(type, { bubbles: true, cancelable: true, dataTransfer: transfer }));
      }
    },
    paths.map((path) => ({ name: basename(path), base64: readFileSync(path, 'base64') })),
  );
await drop([first, second]);
await shown(page, 3);
result.droppedSigns = await texts('#spans .sign button');
result.alertIsHidden = await page.locator('#alert').isHidden();

// Loop a seam: time stays around it, and comes back to its start.
const ends = await page.evaluate(() => {
  const frames = Number(document.querySelector('#frame').max) + 1;
  const { left, width } = document.querySelector('#spans .transition').style;
  return [parseFloat(left), parseFloat(left) + parseFloat(width)].map((percent) => Math.round((percent * frames) / 100));
});
await page.selectOption('#speed', '0.5');
await page.locator('#spans .transition button').first().click();
const seen = await page.evaluate(() => {
  const frames = [];
  return new Promise((done) => {
    const record = () => {
      frames.push(Number(document.querySelector('#frame').value));
      if (frames.at(-1) < frames.at(-2)) done(frames);
      else requestAnimationFrame(record);
    };
    record();
  });
});
result.loop = { ends, seen, chosen: await page.locator('#loop').inputValue() };
await page.selectOption('#speed', '1');
await page.keyboard.press('l');
result.unlooped = await page.locator('#loop').inputValue();
await page.selectOption('#loop', '0');
await page.selectOption('#loop', 'all');
result.everything = await page.locator('#loop').inputValue();

// Keys: one frame forward, two back, mirror, camera.
await pause(page);
await page.locator('#controls').focus();
await seek(page, 10);
await page.keyboard.press('ArrowRight');
result.forward = await frame(page);
await page.keyboard.press('ArrowLeft');
await page.keyboard.press('ArrowLeft');
result.back = await frame(page);
await page.keyboard.press('m');
result.isMirrored = await page.locator('#mirror').getAttribute('aria-pressed');
await page.keyboard.press('m');
await page.keyboard.press('3');
result.handsView = await page.locator('[data-view=hands]').getAttribute('aria-pressed');
await page.keyboard.press('1');

// Dials, and a second method to compare with: both are drawn.
await page.fill('#glosses', 'HELLO DEAF');
await page.keyboard.press('Enter');
await shown(page, 4);
const longer = Number(await page.getAttribute('#frame', 'max'));
await page.locator('#sign-speed').fill('2');
await shown(page, 5);
result.lastFrames = [longer, Number(await page.getAttribute('#frame', 'max'))];
await page.locator('#sign-speed').fill('1');
await shown(page, 6);
await page.selectOption('#compare', 'transition:slerp');
await shown(page, 7);
await pause(page);
await seek(page, 30);
result.compared = { methods: await texts('.side .method'), drawn: await drawn(page) };
await page.screenshot({ path: join(out, 'compared.png') });

// Every download.
result.saved = {};
for (const file of ['bvh', 'glb', 'vrma', 'report', 'page']) {
  const [download] = await Promise.all([page.waitForEvent('download'), page.click(`[data-file=${file}]`)]);
  result.saved[file] = join(out, download.suggestedFilename());
  await download.saveAs(result.saved[file]);
}

// An avatar instead of the mannequin.
await page.selectOption('#compare', '');
await shown(page, 8);
await page.evaluate(() => {
  const transfer = new DataTransfer();
  transfer.items.add(new File(['junk'], 'junk.vrm'));
  document.body.dispatchEvent(new DragEvent('drop', { bubbles: true, cancelable: true, dataTransfer: transfer }));
});
await page.waitForSelector('#alert:not([hidden])');
result.junkAlert = await page.locator('#alert').textContent();
await drop([avatar]);
await shown(page, 9);
await pause(page);
await seek(page, 30);
result.avatar = {
  drawn: await drawn(page),
  alert: await page.locator('#alert').textContent(),
  status: await page.locator('#status').textContent(),
};
await page.screenshot({ path: join(out, 'avatar.png') });

// A film of a few frames: 1080p takes long in software.
await drop([short]);
await shown(page, 10);
const [film] = await Promise.all([page.waitForEvent('download'), page.click('[data-file=film]')]);
result.film = join(out, film.suggestedFilename());
await film.saveAs(result.film);

// The rules of accessibility that axe-core checks.
const { page: plain } = await watched(browser, { bypassCSP: true, viewport: SCREEN });
await plain.goto(address);
await shown(plain, 1);
await plain.addScriptTag({ path: createRequire(import.meta.url).resolve('axe-core/axe.min.js') });
result.axe = await plain.evaluate(async () =>
  (await globalThis.axe.run()).violations.map(({ id, nodes }) => `${id}: ${nodes.map((node) => node.html.slice(0, 120)).join(' | ')}`),
);
await plain.close();

// A sentence that is signed while the first glosses are looked up stays; the address names what is shown, not what failed.
const hurried = await watched(browser, { viewport: SCREEN, reducedMotion: 'reduce' });
const where = async () => ({
  search: await hurried.page.evaluate(() => location.search),
  line: await hurried.page.inputValue('#glosses'),
  signs: await hurried.page.locator('#spans .sign button').allTextContents(),
});
const asked = [];
hurried.page.on('request', (request) => request.url().endsWith('v1/sentence') && asked.push(request.postDataJSON()));
let lookUp;
const lookedUp = new Promise((done) => (lookUp = done));
let held = 0;
await hurried.page.route('**/v1/lexicon?limit=1&*', async (route) => {
  held++;
  await lookedUp;
  await route.continue().catch(() => {}); // aborted
});
await hurried.page.goto(address);
while (held < 3) await hurried.page.waitForTimeout(50);
await hurried.page.fill('#glosses', 'HELLO DEAF SIGN');
await hurried.page.keyboard.press('Enter');
await hurried.page.waitForFunction(() => document.querySelector('#stage').ariaBusy === 'true');
lookUp();
await shown(hurried.page, 1);
await hurried.page.waitForFunction(() => document.querySelector('#stage').ariaBusy === 'false');
result.hurried = { ...(await where()), asked: asked.map(({ glosses }) => glosses) };
await hurried.page.route('**/v1/sentence', async (route) => {
  const answer = await route.fetch();
  const scene = await answer.json();
  await route.fulfill({ response: answer, json: { ...scene, files: { ...scene.files, glb: null } } });
});
await hurried.page.fill('#glosses', 'FRIEND');
await hurried.page.keyboard.press('Enter');
await hurried.page.waitForSelector('#alert:not([hidden])');
result.notShown = await where();
await hurried.page.unroute('**/v1/sentence');

// The tempo, and what moves between the signs.
const lasts = async () => Number(await hurried.page.getAttribute('#frame', 'max'));
result.tempo = { lastFrames: [await lasts()] };
await hurried.page.selectOption('#tempo', 'natural');
await shown(hurried.page, 2);
result.tempo.lastFrames.push(await lasts());
await hurried.page.selectOption('#free-hand', 'transition');
await shown(hurried.page, 3);
await hurried.page.fill('#person', '0.5');
await shown(hurried.page, 4);
result.tempo.asked = [...asked.slice(0, 1), ...asked.slice(-3)].map(({ tempo, free_hand, person }) => [tempo, free_hand, person]);
result.tempo.personValue = await hurried.page.textContent('#person-value');
result.tempo.search = (await where()).search;
result.hurried.faults = hurried.faults;
await hurried.page.close();

// Another language, and a phone.
const phone = await watched(browser, { viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true, deviceScaleFactor: 2, locale: 'zh-CN' });
await phone.page.goto(`${address}?s=DEAF+FRIEND`);
await shown(phone.page, 1);
await pause(phone.page);
await seek(phone.page, 25);
result.phone = {
  language: await phone.page.evaluate(() => document.documentElement.lang),
  sign: await phone.page.locator('#sentence button').textContent(),
  overflow: await phone.page.evaluate(() => document.documentElement.scrollWidth - window.innerWidth),
  smallButtons: await phone.page.evaluate(() =>
    [...document.querySelectorAll('header button, #controls button, #controls select, #downloads button')]
      .filter((element) => element.getBoundingClientRect().height < 44).map((element) => element.outerHTML.slice(0, 60))),
  signs: await phone.page.locator('#spans .sign button').allTextContents(),
  drawn: await drawn(phone.page),
};
await phone.page.screenshot({ path: join(out, 'phone.png') });
result.phone.faults = phone.faults;

// The saved page, from disk, without a network.
const saved = await watched(browser, { offline: true, viewport: SCREEN });
await saved.page.goto(`file://${result.saved.page}`);
await shown(saved.page, 1, true);
const running = [await frame(saved.page), await nextFrame(saved.page)];
await pause(saved.page);
await seek(saved.page, 30);
result.fromDisk = {
  running,
  hasSentenceBox: await saved.page.locator('#sentence').isVisible(),
  signs: await saved.page.locator('#spans .sign button').allTextContents(),
  sides: await saved.page.locator('.side .method').allTextContents(),
  drawn: await drawn(saved.page),
  faults: saved.faults,
  hosts: [...saved.hosts],
};
await saved.page.screenshot({ path: join(out, 'from-disk.png') });

// The page that documents the routes; it needs no other host.
const docs = await watched(browser, {});
await docs.page.goto(`${address}docs`);
await docs.page.waitForSelector('.opblock');
result.docs = { routes: (await docs.page.locator('.opblock').count()), hosts: [...docs.hosts], faults: docs.faults };

result.faults = faults;
result.hosts = [...hosts];
await browser.close();
console.log(JSON.stringify(result, null, 1));
