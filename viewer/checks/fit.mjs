// How the page's own code fits motion to avatars. `node fit.mjs [--time] [--chromium] CASES.json` reads a list of
// {avatar: FILE.vrm, scene: a wire.Spliced} and prints a line of JSON for each: wrists and fingertips in every frame (m, from
// the middle of the shoulders), what the page would warn of, the avatar's capsules, and with --time how long the solver takes
// for all frames, ms: the least of five runs. It runs in Node, or in Chromium.

import { mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { dirname, join } from 'node:path';
import { fileURLToPath } from 'node:url';
import { build } from 'esbuild';

const [timed, inChromium] = ['--time', '--chromium'].map((flag) => process.argv.includes(flag));
const bundle = await build({
  entryPoints: [join(dirname(fileURLToPath(import.meta.url)), 'fit_points.js')],
  bundle: true,
  write: false,
  format: inChromium ? 'iife' : 'esm',
  globalName: inChromium ? 'checks' : undefined,
  target: 'es2022',
  charset: 'utf8',
  logLevel: 'error',
});
const code = bundle.outputFiles[0];
const cases = JSON.parse(readFileSync(process.argv.at(-1), 'utf8')).map(({ avatar, scene }) => [readFileSync(avatar, 'base64'), scene, timed]);

if (inChromium) {
  const { launch, watched } = await import('./browser.mjs');
  const browser = await launch();
  const { page } = await watched(browser);
  await page.addScriptTag({ content: code.text });
  for (const one of cases) print(await page.evaluate((given) => globalThis.checks.fitted(...given), one));
  await browser.close();
} else {
  globalThis.self ??= globalThis; // three's loaders need a browser's global object
  const folder = mkdtempSync(join(tmpdir(), 'fit-'));
  process.on('exit', () => rmSync(folder, { recursive: true }));
  writeFileSync(join(folder, 'fit.mjs'), code.contents);
  const { fitted } = await import(join(folder, 'fit.mjs'));
  for (const one of cases) print(await fitted(...one));
}

function print(found) {
  console.log(JSON.stringify(found));
}
