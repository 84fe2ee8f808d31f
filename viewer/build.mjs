// `node build.mjs DIR` builds the page: one HTML file that contains its script and style, and whose content policy forbids
// everything from other hosts. DIR/docs gets the files of the page that documents the service's routes.

import { createHash } from 'node:crypto';
import { copyFile, mkdir, readFile, readdir, rm, writeFile } from 'node:fs/promises';
import { dirname, join } from 'node:path';
import { fileURLToPath } from 'node:url';
import { build } from 'esbuild';

const here = dirname(fileURLToPath(import.meta.url));
const out = process.argv[2];
if (!out) throw new Error('usage: node build.mjs DIR');

const bundle = await build({
  entryPoints: [join(here, 'src/main.ts')],
  bundle: true,
  minify: true,
  write: false,
  format: 'iife',
  target: 'es2022',
  charset: 'utf8',
  legalComments: 'eof',
  logLevel: 'warning',
  metafile: true,
});
const script = bundle.outputFiles[0].text.replaceAll('</script', '<\\/script').replaceAll('<!--', '<\\!--');
const style = await readFile(join(here, 'src/style.css'), 'utf8');
const digest = (text) => `'sha256-${createHash('sha256').update(text).digest('base64')}'`;
const policy = [
  "default-src 'none'",
  `script-src ${digest(script)}`,
  `style-src ${digest(style)}`,
  'img-src data: blob:',
  "connect-src 'self' data: blob:",
  'worker-src blob:',
  "form-action 'none'",
  "base-uri 'none'",
].join('; ');
const page = (await readFile(join(here, 'src/page.html'), 'utf8'))
  .replace('POLICY', () => policy)
  .replace('STYLE', () => style)
  .replace('SCRIPT', () => script);

await rm(out, { recursive: true, force: true });
await mkdir(join(out, 'docs'), { recursive: true });
await writeFile(join(out, 'index.html'), page);
for (const file of ['swagger-ui-bundle.js', 'swagger-ui.css', 'LICENSE', 'NOTICE']) {
  await copyFile(join(here, 'node_modules/swagger-ui-dist', file), join(out, 'docs', file));
}

// The packages that the page contains, with their licences.
const packages = new Set(
  Object.keys(bundle.metafile.inputs).flatMap((path) => path.match(/node_modules\/((?:@[^/]+\/)?[^/]+)/)?.[1] ?? []),
);
let licences = 'The page contains code of these packages, each under its licence.\n';
for (const name of [...packages].sort()) {
  const folder = join(here, 'node_modules', name);
  const { version, license } = JSON.parse(await readFile(join(folder, 'package.json'), 'utf8'));
  const file = (await readdir(folder)).find((entry) => /^licen[cs]e/i.test(entry));
  const text = file ? await readFile(join(folder, file), 'utf8') : '';
  licences += `\n${'='.repeat(80)}\n${name} ${version}, ${license}\n\n${text}`;
}
await writeFile(join(out, 'LICENCES.txt'), licences);
