// Pages that use <sign-player> from a file server, as their users would; prints what was seen as JSON.
// `CHROMIUM=... node player.mjs SITE SERVICE OUT`: SITE serves the examples with the installed package and its files.

import { readFileSync, writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { join } from 'node:path';
import { launch, watched } from './browser.mjs';
import { packedWithMeshopt, saidToBeDraco } from './pack.mjs';

const [site, service, out] = process.argv.slice(2);
const AXE = createRequire(import.meta.url).resolve('axe-core/axe.min.js');
const browser = await launch();
const result = { faults: [], hosts: [] };

/** A page that notes what its players say from the first on. */
async function open(name, options = {}) {
  const { page, faults, hosts } = await watched(browser, { viewport: { width: 390, height: 844 }, reducedMotion: 'reduce', ...options });
  result.faults.push(faults);
  result.hosts.push(hosts);
  await page.addInitScript(() => {
    globalThis.said = [];
    for (const type of ['ready', 'word', 'error', 'play', 'pause', 'ended']) {
      document.addEventListener(type, ({ target, detail }) => target.localName === 'sign-player' && said.push([type, detail]), true);
    }
    const drawn = () => said.push(['drawn', performance.now()]); // since the page was asked for
    addEventListener('ready', () => requestAnimationFrame(() => requestAnimationFrame(drawn)), { capture: true, once: true });
  });
  await page.goto(site + name);
  return page;
}
const heard = (page, type, n = 1) => page.waitForFunction(([wanted, n]) => said.filter(([one]) => one === wanted).length >= n, [type, n]);
const said = (page, type) => page.evaluate((wanted) => said.flatMap(([one, detail]) => (one === wanted ? [detail] : [])), type);
const state = (page) =>
  page.evaluate(() => {
    const { duration, currentTime, paused, words, rate, captions } = document.querySelector('sign-player');
    return { duration, currentTime, paused, words: words.map(({ gloss }) => gloss), rate, captions };
  });
const axe = async (page) => {
  await page.addScriptTag({ path: AXE });
  const found = await page.evaluate(async () => (await globalThis.axe.run()).violations);
  return found.map(({ id, nodes }) => `${id}: ${nodes.map((node) => node.html.slice(0, 120)).join(' | ')}`);
};
const drawn = (page) =>
  page.evaluate(async () => {
    await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
    const pen = new OffscreenCanvas(100, 100).getContext('2d');
    pen.drawImage(globalThis.picture(), 0, 0, 100, 100);
    const { data } = pen.getImageData(0, 0, 100, 100);
    return data.filter((value, k) => k % 4 === 0 && Math.abs(value - data[0]) > 24).length / 10_000;
  });

// Plain HTML: it waits, since this user wants little motion; keys and controls play it; words come with their times.
const plain = await open('plain.html');
await heard(plain, 'drawn');
result.firstFrameMs = (await said(plain, 'drawn'))[0]; // for docs/player.md; no test compares it
result.plain = { ready: (await said(plain, 'ready'))[0], atRest: await state(plain), drawn: await drawn(plain), axe: await axe(plain) };
await plain.locator('sign-player input[type=range]').focus();
await plain.keyboard.press('ArrowRight');
await plain.keyboard.press('ArrowRight');
result.plain.stepped = (await state(plain)).currentTime;
result.plain.valueText = await plain.locator('sign-player input[type=range]').getAttribute('aria-valuetext');
await plain.keyboard.press('m');
await plain.keyboard.press('c');
result.plain.toggled = await plain.evaluate(() => ['mirrored', 'captions'].map((name) => document.querySelector('sign-player').hasAttribute(name)));
await plain.locator('sign-player select').selectOption('2');
await plain.locator('sign-player button').first().click();
await heard(plain, 'ended');
result.plain.words = await said(plain, 'word');
result.plain.output = await plain.locator('p output').textContent();
result.plain.atEnd = await state(plain);
await plain.screenshot({ path: join(out, 'plain.png') });

// Moved within the page, taken out and put back.
await plain.evaluate(() => document.querySelector('main').prepend(document.querySelector('sign-player')));
result.plain.moved = (await said(plain, 'ready')).length;
await plain.evaluate(async () => {
  const player = document.querySelector('sign-player');
  player.remove();
  await new Promise((done) => setTimeout(done, 50));
  document.querySelector('main').append(player);
});
await heard(plain, 'ready', 2);
result.plain.drawnAgain = await drawn(plain);

// What does not come is said.
await plain.evaluate(() => (document.querySelector('sign-player').src = 'missing.glb'));
await heard(plain, 'error');
result.plain.error = (await said(plain, 'error'))[0].message;
result.plain.note = await plain.locator('sign-player [role=alert]').textContent();
result.expectedFaults = result.faults.at(-1).splice(0);

// React.
const react = await open('react.html');
await heard(react, 'ready');
result.react = { axe: await axe(react), drawn: await drawn(react) };
await react.getByText('Slowly').click();
result.react.rate = (await state(react)).rate;
await react.evaluate(() => (document.querySelector('sign-player').src = 'hello.glb?again'));
await heard(react, 'ready', 2);
await react.locator('sign-player button').first().click();
await react.waitForFunction(() => document.querySelector('p output').textContent !== '');
result.react.output = await react.locator('p output').textContent();

// The user's own avatar, and another that is no VRM.
const own = await open('avatar.html');
await heard(own, 'ready');
result.own = { axe: await axe(own), drawn: await drawn(own) };
const isCopied = () => own.evaluate(() => document.querySelector('sign-player').show.people[0].isCopied);
result.own.isCopied = await isCopied();
result.own.warnings = (await said(own, 'ready'))[0].warnings;
const hands = () => own.evaluate(() => {
  const { people, player } = document.querySelector('sign-player').show;
  return [0, 20, 40, 60].map((frame) => (people[0].at(frame / player.fps), people[0].handsAt(-9)));
});
await own.locator('input[type=file]').setInputFiles(join(out, 'hanging.glb'));
await heard(own, 'ready', 2);
result.own.hands = [await hands()];
await own.locator('input[type=file]').setInputFiles(join(out, 'figure.glb'));
await heard(own, 'ready', 3);
result.own.hands.unshift(await hands());
result.own.isCopiedAgain = await isCopied();
result.own.drawnAgain = await drawn(own);
await own.screenshot({ path: join(out, 'own.png') });

// The same packed, which is read, or said to be, in one line, that it is not.
const figure = readFileSync(join(out, 'figure.glb'));
writeFileSync(join(out, 'packed.glb'), await packedWithMeshopt(figure));
writeFileSync(join(out, 'draco.glb'), saidToBeDraco(figure));
await own.locator('input[type=file]').setInputFiles(join(out, 'packed.glb'));
await heard(own, 'ready', 4);
result.own.packed = { isCopied: await isCopied(), drawn: await drawn(own) };
await own.locator('input[type=file]').setInputFiles(join(out, 'draco.glb'));
await heard(own, 'error');
result.own.draco = (await said(own, 'error'))[0].message;
for (const k of [0, 1, 2]) {
  await own.locator('input[type=file]').setInputFiles(join(out, `loop-${k}.glb`));
  await heard(own, 'error', k + 2);
}
result.own.loops = (await said(own, 'error')).slice(1).map(({ message }) => message);

// Without words yet the avatar stands at rest; without a style on its page a player has a sensible size.
await own.locator('input[type=file]').setInputFiles(join(out, 'figure.glb'));
await heard(own, 'ready', 5);
result.own.atRest = await own.evaluate(async () => {
  const player = document.querySelector('sign-player');
  const [before] = player.show.people;
  player.src = '';
  while (player.show.people[0] === before) await new Promise((done) => setTimeout(done, 50));
  const { min, max } = player.show.people[0].handsAt(-9);
  return { hands: [min.y, max.y], wide: max.x - min.x };
});
result.own.atRest.drawn = await drawn(own);
result.own.bare = await own.evaluate(() => {
  const host = document.body.appendChild(document.createElement('div'));
  const player = host.attachShadow({ mode: 'open' }).appendChild(document.createElement('sign-player'));
  const { width, height } = player.getBoundingClientRect();
  host.remove();
  return [width, height, host.clientWidth];
});

// On an avatar, a service fits a file and sentences to its body: those that are streamed are as those that come whole.
const pose = () => fitted.evaluate(() => {
  const { people, player } = document.querySelector('sign-player').show;
  return [0, 30, 61, 100, 200].map((frame) => (people[0].at(frame / player.fps), people[0].handsAt(-9)));
});
const fitted = await open('plain.html');
await heard(fitted, 'ready');
await fitted.evaluate((address) => Object.assign(document.querySelector('sign-player'), { service: address, avatar: 'avatar.vrm' }), service);
await heard(fitted, 'ready', 2);
result.fitted = { file: await fitted.evaluate(() => document.querySelector('sign-player').words.map(({ gloss }) => gloss)), drawn: await drawn(fitted), hands: [] };
for (const [k, avatar] of ['avatar.vrm', 'Ann'].entries()) {
  for (const n of [1, 2]) {
    const line = Array.from({ length: 8 * n }, (_, k) => ['HELLO', 'MY', 'NAME', 'DEAF', 'FRIEND', 'MOTHER', 'THANK-YOU'][k % 7]).join(' ');
    await fitted.evaluate((given) => Object.assign(document.querySelector('sign-player'), given), { src: '', gloss: line, avatar });
    await heard(fitted, 'ready', 2 * k + n + 2);
    if (n === 2) await fitted.waitForFunction(() => document.querySelector('sign-player').show.player.frames > 201);
    result.fitted.hands.push(await pose());
  }
}
result.fitted.drawnStream = await drawn(fitted);
await fitted.screenshot({ path: join(out, 'fitted.png') });

// A long sentence, streamed: while it is paused the service is held back, then all of it comes.
const stream = await open('plain.html');
const sent = [];
stream.on('websocket', (socket) => socket.on('framesent', ({ payload }) => sent.push(JSON.parse(payload))));
await heard(stream, 'ready');
const words = Array.from({ length: 100 }, (_, k) => (k === 50 ? '你好' : ['HELLO', 'MY', 'NAME', 'DEAF', 'FRIEND'][k % 5]));
await stream.evaluate(([line, address]) => {
  Object.assign(document.querySelector('sign-player'), { service: address, gloss: line, src: '' });
}, [words.join(' '), service]);
await heard(stream, 'ready', 2);
let before = -1;
while (sent.length > before) {
  before = sent.length;
  await stream.waitForTimeout(1500);
}
result.stream = { words, sentPaused: sent.length, paused: await state(stream) };
await stream.evaluate(() => {
  const player = document.querySelector('sign-player');
  globalThis.ahead = 0;
  player.rate = 8;
  player.play();
  const look = () => {
    globalThis.ahead = Math.max(globalThis.ahead, player.duration - player.currentTime);
    requestAnimationFrame(look);
  };
  look();
});
await heard(stream, 'ended');
Object.assign(result.stream, { sent: [...sent], ahead: await stream.evaluate(() => globalThis.ahead), state: await state(stream), heard: await said(stream, 'word'), errors: await said(stream, 'error') });
result.stream.points = await stream.evaluate(() => {
  const { people, player } = document.querySelector('sign-player').show;
  return [0, 30, 61, 100, 200].map((frame) => (people[0].at(frame / player.fps), people[0].handsAt(-9)));
});

// The same words as one sentence.
await stream.evaluate((line) => Object.assign(document.querySelector('sign-player'), { gloss: line }), words.slice(0, 12).join(' '));
await heard(stream, 'ready', 3);
result.stream.whole = await stream.evaluate(() => {
  const { people, player } = document.querySelector('sign-player').show;
  return [0, 30, 61, 100, 200].map((frame) => (people[0].at(frame / player.fps), people[0].handsAt(-9)));
});

// A question and a gloss of several words, streamed: what is read and what the face shows.
await stream.evaluate(() => Object.assign(document.querySelector('sign-player'), {
  gloss: '', text: 'Hello my friend. I am deaf. What your name? My name my friend hello hello friend I love you my friend', rate: 8,
}));
await heard(stream, 'ready', 4);
await stream.evaluate(() => document.querySelector('sign-player').play());
await heard(stream, 'ended', 2);
result.face = await stream.evaluate(() => {
  const { show, words } = document.querySelector('sign-player');
  const [person] = show.people;
  const faces = [];
  person.root.traverse((node) => node.morphTargetDictionary && faces.push(node));
  const most = {};
  for (let frame = 0; frame < show.player.frames; frame++) {
    person.at(frame / show.player.fps);
    for (const { morphTargetDictionary: names, morphTargetInfluences: weights } of faces) {
      for (const [name, k] of Object.entries(names)) most[name] = Math.max(most[name] ?? 0, weights[k]);
    }
  }
  return { words: words.map(({ gloss }) => gloss), most };
});

// Without WebGL: what the service draws, and what to do.
const flat = await open('plain.html');
await flat.addInitScript(() => (HTMLCanvasElement.prototype.getContext = () => null));
await flat.reload();
await heard(flat, 'error');
await flat.evaluate((address) => Object.assign(document.querySelector('sign-player'), { service: address, gloss: 'HELLO', src: '' }), service);
await flat.waitForFunction(() => document.querySelector('sign-player').shadowRoot.querySelector('img')?.naturalWidth > 0);
result.flat = {
  note: await flat.locator('sign-player [role=alert]').textContent(),
  alt: await flat.locator('sign-player img').getAttribute('alt'),
  axe: await axe(flat),
};
const drawnType = () => flat.evaluate(async () => (await (await fetch(document.querySelector('sign-player').shadowRoot.querySelector('img').src)).blob()).type);
result.flat.types = [await drawnType()];
await flat.locator('sign-player .film').focus();
for (const pressed of ['true', 'false']) {
  await flat.keyboard.press('Enter');
  await flat.waitForFunction(() => document.querySelector('sign-player').shadowRoot.querySelector('.stage').ariaBusy === 'false');
  result.flat.types.push([await flat.locator('sign-player .film').getAttribute('aria-pressed'), pressed, await drawnType()]);
}
await flat.screenshot({ path: join(out, 'flat.png') });
result.faults.at(-1).splice(0); // three.js tells the console that there is no WebGL

result.hosts = [...new Set(result.hosts.flatMap((hosts) => [...hosts]))];
result.faults = result.faults.flat();
await browser.close();
console.log(JSON.stringify(result, null, 1));
