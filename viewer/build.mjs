// `node build.mjs DIR` builds the page: one HTML file that contains its script and style, and whose content policy forbids
// everything from other hosts. DIR/docs gets the files of the page that documents the service's routes. LICENCES.txt and
// components.json (CycloneDX) name the packages in both; the licences are in the page too, since it is saved and passed on.

import { createHash } from 'node:crypto';
import { copyFile, mkdir, readFile, rm, writeFile } from 'node:fs/promises';
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

// Bundled packages, and those that a bundled package's build contains already: its licence comments name them.
const manifest = async (name) => JSON.parse(await readFile(join(here, 'node_modules', name, 'package.json'), 'utf8'));
const inputs = Object.values(bundle.metafile.outputs).flatMap((output) => Object.keys(output.inputs));
const bundled = new Set(inputs.flatMap((path) => path.match(/node_modules\/((?:@[^/]+\/)?[^/]+)/)?.[1] ?? []));
for (const name of bundled) {
  const { dependencies } = await manifest(name);
  for (const inner of Object.keys(dependencies ?? {})) if (script.includes(`* ${inner} v`)) bundled.add(inner);
}
const docs = 'swagger-ui-dist';
const lock = JSON.parse(await readFile(join(here, 'package-lock.json'), 'utf8')).packages;
const components = [];
const texts = new Map();
for (const name of [...bundled, docs].sort()) {
  const { version, license, repository } = await manifest(name);
  const source = (repository.url ?? repository).replace(/^git\+/, '').replace(/^git@([^:]+):/, 'https://$1/').replace(/\.git$/, '');
  const [algorithm, digest64] = lock[`node_modules/${name}`].integrity.split('-');
  const purl = `pkg:npm/${name.replace('@', '%40')}@${version}`;
  components.push({
    type: 'library',
    'bom-ref': purl,
    name,
    version,
    purl,
    licenses: [{ expression: license }],
    hashes: [{ alg: algorithm.replace('sha', 'SHA-'), content: Buffer.from(digest64, 'base64').toString('hex') }],
    externalReferences: [{ type: 'vcs', url: source }],
  });
  if (name === docs) continue;
  const text = await readFile(join(here, 'node_modules', name, 'LICENSE'), 'utf8');
  texts.set(text, [...(texts.get(text) ?? []), `${name} ${version}, ${license}, unchanged; source: ${source}`]);
}
// Swagger UI comes built; its list of what that build contains has no versions.
const sizes = await readFile(join(here, 'node_modules', docs, 'log.bundle-sizes.swagger-ui.txt'), 'utf8');
components.find(({ name }) => name === docs).components = [...sizes.matchAll(/^([^<\s:]+): /gm)].map(([, name]) => ({
  type: 'library',
  name,
}));

let licences = 'This page contains code of these packages, each under its licence.\n';
for (const [text, names] of texts) licences += `\n${'='.repeat(80)}\n${names.join('\n')}\n\n${text}`;
if (licences.includes('-->')) throw new Error('a licence would end the comment that holds it');
const page = (await readFile(join(here, 'src/page.html'), 'utf8'))
  .replace('POLICY', () => policy)
  .replace('STYLE', () => style)
  .replace('SCRIPT', () => script)
  .replace('LICENCES', () => licences);

await rm(out, { recursive: true, force: true });
await mkdir(join(out, 'docs'), { recursive: true });
await writeFile(join(out, 'index.html'), page);
await writeFile(join(out, 'LICENCES.txt'), licences);
await writeFile(join(out, 'components.json'), JSON.stringify(components, null, 1));
for (const file of ['swagger-ui-bundle.js', 'swagger-ui-bundle.js.LICENSE.txt', 'swagger-ui.css', 'LICENSE', 'NOTICE']) {
  await copyFile(join(here, 'node_modules', docs, file), join(out, 'docs', file));
}
