// Drives the service's page in a headless Chromium as a person would, and prints what it saw as JSON.
// `CHROMIUM=... node page.mjs ADDRESS OUT A.bvh B.bvh AVATAR.vrm SHORT.bvh`; pictures and downloads are left in OUT.

import { readFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { basename, join } from 'node:path';
import { drawn, frame, later, launch, pause, seek, shown, watched } from './browser.mjs';

const [address, out, first, second, avatar, short] = process.argv.slice(2);
const browser = await launch();
const told = {};
const { page, faults, hosts } = await watched(browser, { viewport: { width: 1360, height: 860 } });
const texts = (query) => page.locator(query).allTextContents();

// The page comes up and signs.
await page.goto(address);
await shown(page, 1, true);
told.greeted = await texts('#spans .sign button');
told.plays = await page.locator('#play').textContent();
told.drawn = await drawn(page);
told.runs = [await frame(page), await later(page)];
await pause(page);

// A sentence is typed, a gloss of it completed.
await page.fill('#glosses', '');
await page.locator('#glosses').pressSequentially('fs-AB thank', { delay: 15 });
await page.waitForSelector('#suggestions:not([hidden]) li');
told.suggested = await texts('#suggestions li');
await page.keyboard.press('ArrowDown');
told.active = await page.getAttribute('#glosses', 'aria-activedescendant');
await page.keyboard.press('Enter');
told.typed = await page.inputValue('#glosses');
await page.keyboard.press('Enter');
await shown(page, 2, true);
told.typedSigns = await texts('#spans .sign button');
told.typedPlays = await page.locator('#play').textContent();
await pause(page);
await seek(page, 2);
told.caption = await page.locator('.caption').first().textContent();
told.letter = await texts('.caption b');

// What is not there is said, and nothing is lost.
await page.fill('#glosses', 'HELLO ÅÄÖ§');
await page.keyboard.press('Enter');
await page.waitForSelector('#alert:not([hidden])');
told.unknown = await page.locator('#alert').textContent();
told.expected = faults.splice(0); // the browser tells of the 422 itself
told.kept = await texts('#spans .sign button');

// Two files are dropped.
const drop = (paths) =>
  page.evaluate(
    (files) => {
      const transfer = new DataTransfer();
      for (const { name, bytes } of files) transfer.items.add(new File([Uint8Array.from(bytes)], name));
      for (const type of ['dragenter', 'dragover', 'drop']) {
        document.body.dispatchEvent(new DragEvent(type, { bubbles: true, cancelable: true, dataTransfer: transfer }));
      }
    },
    paths.map((path) => ({ name: basename(path), bytes: [...readFileSync(path)] })),
  );
await drop([first, second]);
await shown(page, 3);
told.dropped = await texts('#spans .sign button');
told.alert = await page.locator('#alert').isHidden();

// A seam is looped: time stays around it, and comes back to its start.
const ends = await page.evaluate(() => {
  const frames = Number(document.querySelector('#frame').max) + 1;
  const { left, width } = document.querySelector('#spans .transition').style;
  return [parseFloat(left), parseFloat(left) + parseFloat(width)].map((share) => Math.round((share * frames) / 100));
});
await page.locator('#spans .transition button').first().click();
const seen = [];
const cameBack = () => seen.some((value, k) => k > 0 && value < seen[k - 1]);
for (const late = Date.now() + 60_000; Date.now() < late && !cameBack(); await page.waitForTimeout(40)) {
  seen.push(await frame(page));
}
told.loop = { ends, seen, chosen: await page.locator('#loop').inputValue() };
await page.keyboard.press('l');
told.unlooped = await page.locator('#loop').inputValue();
await page.selectOption('#loop', '0');
await page.selectOption('#loop', 'all');
told.everything = await page.locator('#loop').inputValue();

// Keys: pause, one frame on, two back, the next seam.
await pause(page);
await page.locator('#controls').focus();
await seek(page, 10);
await page.keyboard.press('ArrowRight');
told.on = await frame(page);
await page.keyboard.press('ArrowLeft');
await page.keyboard.press('ArrowLeft');
told.back = await frame(page);
await page.keyboard.press('m');
told.mirrored = await page.locator('#mirror').getAttribute('aria-pressed');
await page.keyboard.press('m');
await page.keyboard.press('3');
told.view = await page.locator('[data-view=hands]').getAttribute('aria-pressed');
await page.keyboard.press('1');

// Dials and a second method beside the first; in step, both drawn.
await page.fill('#glosses', 'HELLO DEAF');
await page.keyboard.press('Enter');
await shown(page, 4);
const longer = Number(await page.getAttribute('#frame', 'max'));
await page.locator('#sign-speed').fill('2');
await shown(page, 5);
told.faster = [longer, Number(await page.getAttribute('#frame', 'max'))];
await page.locator('#sign-speed').fill('1');
await shown(page, 6);
await page.selectOption('#beside', 'transition:slerp');
await shown(page, 7);
await pause(page);
await seek(page, 30);
told.beside = { methods: await texts('.side .method'), drawn: await drawn(page) };
await page.screenshot({ path: join(out, 'beside.png') });

// Everything can be taken away.
told.saved = {};
for (const file of ['bvh', 'glb', 'vrma', 'report', 'page']) {
  const [download] = await Promise.all([page.waitForEvent('download'), page.click(`[data-file=${file}]`)]);
  told.saved[file] = join(out, download.suggestedFilename());
  await download.saveAs(told.saved[file]);
}

// An avatar in place of the mannequin.
await page.selectOption('#beside', '');
await shown(page, 8);
await page.evaluate(() => {
  const transfer = new DataTransfer();
  transfer.items.add(new File(['junk'], 'junk.vrm'));
  document.body.dispatchEvent(new DragEvent('drop', { bubbles: true, cancelable: true, dataTransfer: transfer }));
});
await page.waitForSelector('#alert:not([hidden])');
told.junk = await page.locator('#alert').textContent();
await drop([avatar]);
await shown(page, 9);
await pause(page);
await seek(page, 30);
told.avatar = { drawn: await drawn(page), alert: await page.locator('#alert').textContent() };
await page.screenshot({ path: join(out, 'avatar.png') });

// A film of a few frames (1080p by software takes its time).
await drop([short]);
await shown(page, 10);
const [film] = await Promise.all([page.waitForEvent('download'), page.click('[data-file=film]')]);
told.film = join(out, film.suggestedFilename());
await film.saveAs(told.film);

// Rules of accessibility that a program can check (axe-core).
const { page: plain } = await watched(browser, { bypassCSP: true, viewport: { width: 1360, height: 860 } });
await plain.goto(address);
await shown(plain, 1);
await plain.addScriptTag({ path: createRequire(import.meta.url).resolve('axe-core/axe.min.js') });
told.axe = await plain.evaluate(async () =>
  (await globalThis.axe.run()).violations.map(({ id, nodes }) => `${id}: ${nodes.map((node) => node.html.slice(0, 120)).join(' | ')}`),
);
await plain.close();

// Another language, and a phone.
const phone = await watched(browser, { viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true, deviceScaleFactor: 2, locale: 'zh-CN' });
await phone.page.goto(`${address}?s=DEAF+FRIEND`);
await shown(phone.page, 1);
await pause(phone.page);
await seek(phone.page, 25);
told.phone = {
  language: await phone.page.evaluate(() => document.documentElement.lang),
  sign: await phone.page.locator('#sentence button').textContent(),
  wide: await phone.page.evaluate(() => document.documentElement.scrollWidth - window.innerWidth),
  small: await phone.page.evaluate(() =>
    [...document.querySelectorAll('header button, #controls button, #controls select, #downloads button')]
      .filter((one) => one.getBoundingClientRect().height < 44).map((one) => one.outerHTML.slice(0, 60))),
  signs: await phone.page.locator('#spans .sign button').allTextContents(),
  drawn: await drawn(phone.page),
};
await phone.page.screenshot({ path: join(out, 'phone.png') });
told.phone.faults = phone.faults;

// The saved page, from disk, without a network.
const saved = await watched(browser, { offline: true, viewport: { width: 1360, height: 860 } });
await saved.page.goto(`file://${told.saved.page}`);
await shown(saved.page, 1, true);
const run = [await frame(saved.page), await later(saved.page)];
await pause(saved.page);
await seek(saved.page, 30);
told.fromDisk = {
  run,
  live: await saved.page.locator('#sentence').isVisible(),
  signs: await saved.page.locator('#spans .sign button').allTextContents(),
  sides: await saved.page.locator('.side .method').allTextContents(),
  drawn: await drawn(saved.page),
  faults: saved.faults,
  hosts: [...saved.hosts],
};
await saved.page.screenshot({ path: join(out, 'from-disk.png') });

// The page of the routes, offline too but for its own host.
const docs = await watched(browser, {});
await docs.page.goto(`${address}docs`);
await docs.page.waitForSelector('.opblock');
told.docs = { routes: (await docs.page.locator('.opblock').count()), hosts: [...docs.hosts], faults: docs.faults };

told.faults = faults;
told.hosts = [...hosts];
await browser.close();
console.log(JSON.stringify(told, null, 1));
