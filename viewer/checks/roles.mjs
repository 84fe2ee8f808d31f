// Which bones the player knows by name. `node roles.mjs RIGS.json` reads {rig: [names of joints]} and prints {rig: {role: name}}.

import { mkdtempSync, readFileSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { dirname, join } from 'node:path';
import { fileURLToPath } from 'node:url';
import { build } from 'esbuild';

globalThis.self ??= globalThis; // three's loaders need a browser's global object
const folder = mkdtempSync(join(tmpdir(), 'roles-'));
process.on('exit', () => rmSync(folder, { recursive: true }));
const entry = join(dirname(fileURLToPath(import.meta.url)), '../src/humanoid.ts');
const outfile = join(folder, 'humanoid.mjs');
await build({ entryPoints: [entry], bundle: true, outfile, format: 'esm', target: 'es2022', logLevel: 'error' });
const { rolesOf } = await import(outfile);
const found = Object.entries(JSON.parse(readFileSync(process.argv[2], 'utf8'))).map(([rig, names]) => {
  const roles = rolesOf({ nodes: names.map((name) => ({ name })), skins: [{ joints: [...names.keys()] }] });
  return [rig, Object.fromEntries([...roles].map(([role, node]) => [role, names[node]]))];
});
console.log(JSON.stringify(Object.fromEntries(found)));
