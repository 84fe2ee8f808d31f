// `node build.mjs DIR` builds the page: one HTML file that contains its script and style, and whose content policy forbids
// everything from other hosts. DIR/docs gets the files of the page that documents the service's routes. LICENCES.txt and
// components.json (CycloneDX) name the packages in both; the licences are in the page too, since it is saved and passed on.
// `node build.mjs --player DIR` builds the package of <sign-player>: one module, beside the types that tsc writes.

import { createHash } from 'node:crypto';
import { copyFile, mkdir, readdir, readFile, rm, writeFile } from 'node:fs/promises';
import { dirname, join } from 'node:path';
import { fileURLToPath } from 'node:url';
import { build } from 'esbuild';

const here = dirname(fileURLToPath(import.meta.url));
const isPlayer = process.argv[2] === '--player';
const out = process.argv.at(isPlayer ? 3 : 2);
if (!out) throw new Error('usage: node build.mjs [--player] DIR');
const DOCS = 'swagger-ui-dist';
const lock = JSON.parse(await readFile(join(here, 'package-lock.json'), 'utf8')).packages;

await (isPlayer ? buildPlayer() : buildPage());

async function buildPlayer() {
  const { script, packages } = await bundled('src/sign_player.ts', 'esm');
  await mkdir(out, { recursive: true });
  await writeFile(join(out, 'sign-player.js'), script);
  await writeFile(join(out, 'LICENCES.txt'), await licencesOf('This module', packages));
  await copyFile(join(here, '../LICENSE'), join(out, 'LICENSE'));
}

async function buildPage() {
  const { script, packages } = await bundled('src/main.ts', 'iife');
  const inline = script.replaceAll('</script', '<\\/script').replaceAll('<!--', '<\\!--');
  const style = await readFile(join(here, 'src/style.css'), 'utf8');
  const digest = (text) => `'sha256-${createHash('sha256').update(text).digest('base64')}'`;
  const policy = [
    "default-src 'none'",
    `script-src ${digest(inline)} 'wasm-unsafe-eval'`,
    `style-src ${digest(style)}`,
    'img-src data: blob:',
    "connect-src 'self' data: blob:",
    'worker-src blob:',
    "form-action 'none'",
    "base-uri 'none'",
  ].join('; ');
  const licences = await licencesOf('This page', packages);
  if (licences.includes('-->')) throw new Error('a licence would end the comment that holds it');
  const page = (await readFile(join(here, 'src/page.html'), 'utf8'))
    .replace('POLICY', () => policy)
    .replace('STYLE', () => style)
    .replace('SCRIPT', () => inline)
    .replace('LICENCES', () => licences);
  const components = [];
  for (const name of [...packages, DOCS].sort()) components.push(await componentOf(name));
  // Swagger UI comes built; its list of what that build contains has no versions.
  const sizes = await readFile(join(here, 'node_modules', DOCS, 'log.bundle-sizes.swagger-ui.txt'), 'utf8');
  components.find(({ name }) => name === DOCS).components = [...sizes.matchAll(/^([^<\s:]+): /gm)].map(([, name]) => ({
    type: 'library',
    name,
  }));
  await rm(out, { recursive: true, force: true });
  await mkdir(join(out, 'docs'), { recursive: true });
  await writeFile(join(out, 'index.html'), page);
  await writeFile(join(out, 'LICENCES.txt'), licences);
  await writeFile(join(out, 'components.json'), JSON.stringify(components, null, 1));
  for (const file of ['swagger-ui-bundle.js', 'swagger-ui-bundle.js.LICENSE.txt', 'swagger-ui.css', 'LICENSE', 'NOTICE']) {
    await copyFile(join(here, 'node_modules', DOCS, file), join(out, 'docs', file));
  }
}

/** A bundle, and the packages in it: also those that a bundled package's build contains, which its licence comments name. */
async function bundled(entry, format) {
  const { outputFiles, metafile } = await build({
    entryPoints: [join(here, entry)],
    bundle: true,
    minify: true,
    write: false,
    format,
    target: 'es2022',
    loader: { '.css': 'text' },
    charset: 'utf8',
    legalComments: 'eof',
    logLevel: 'warning',
    metafile: true,
  });
  const script = outputFiles[0].text;
  const inputs = Object.values(metafile.outputs).flatMap((output) => Object.keys(output.inputs));
  const packages = new Set(inputs.flatMap((path) => path.match(/node_modules\/((?:@[^/]+\/)?[^/]+)/)?.[1] ?? []));
  for (const name of packages) {
    const { dependencies } = await manifest(name);
    for (const inner of Object.keys(dependencies ?? {})) if (script.includes(`* ${inner} v`)) packages.add(inner);
  }
  return { script, packages: [...packages].sort() };
}

async function manifest(name) {
  const found = JSON.parse(await readFile(join(here, 'node_modules', name, 'package.json'), 'utf8'));
  const address = found.repository.url ?? found.repository;
  return { ...found, source: address.replace(/^git\+/, '').replace(/^git@([^:]+):/, 'https://$1/').replace(/\.git$/, '') };
}

async function componentOf(name) {
  const { version, license, source } = await manifest(name);
  const [algorithm, digest64] = lock[`node_modules/${name}`].integrity.split('-');
  const purl = `pkg:npm/${name.replace('@', '%40')}@${version}`;
  return {
    type: 'library',
    'bom-ref': purl,
    name,
    version,
    purl,
    licenses: [{ expression: license }],
    hashes: [{ alg: algorithm.replace('sha', 'SHA-'), content: Buffer.from(digest64, 'base64').toString('hex') }],
    externalReferences: [{ type: 'vcs', url: source }],
  };
}

async function licencesOf(what, packages) {
  const texts = new Map();
  for (const name of packages) {
    const { version, license, source } = await manifest(name);
    const folder = join(here, 'node_modules', name);
    const text = await readFile(join(folder, (await readdir(folder)).find((file) => /^LICENSE(\.md)?$/.test(file))), 'utf8');
    texts.set(text, [...(texts.get(text) ?? []), `${name} ${version}, ${license}, unchanged; source: ${source}`]);
  }
  let licences = `${what} contains code of these packages, each under its licence.\n`;
  for (const [text, names] of texts) licences += `\n${'='.repeat(80)}\n${names.join('\n')}\n\n${text}`;
  return licences;
}
