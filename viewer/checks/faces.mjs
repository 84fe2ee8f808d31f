// Faces as other programs show them: three.js plays a .glb, @pixiv/three-vrm a .vrma on a .vrm, in a headless Chromium.
// `CHROMIUM=... node faces.mjs OUT FPS N MODEL ANIMATION|- [MODEL ANIMATION|-]...` writes OUT/ROW-FRAME.png of the first N
// frames of each pair, and prints the weights of its morph targets in those frames as JSON.

import { readFileSync, writeFileSync } from 'node:fs';
import { join } from 'node:path';
import { build } from 'esbuild';
import { launch, watched } from './browser.mjs';

const [out, fps, count, ...files] = process.argv.slice(2);
const SCRIPT = `
import * as THREE from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { VRMLoaderPlugin, VRMUtils } from '@pixiv/three-vrm';
import { VRMAnimationLoaderPlugin, createVRMAnimationClip } from '@pixiv/three-vrm-animation';

const renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
renderer.setSize(180, 180);
const load = (base64, plugin) => {
  const loader = new GLTFLoader();
  if (plugin) loader.register((parser) => new plugin(parser));
  return loader.parseAsync(Uint8Array.from(atob(base64), (character) => character.charCodeAt(0)).buffer, '');
};
globalThis.play = async (model, animation, times) => {
  const file = await load(model, animation && VRMLoaderPlugin);
  const vrm = file.userData.vrm;
  if (vrm) VRMUtils.rotateVRM0(vrm);
  const played = animation && (await load(animation, VRMAnimationLoaderPlugin)).userData.vrmAnimations[0];
  const scene = new THREE.Scene();
  scene.background = new THREE.Color(0xf4f1ec);
  const light = new THREE.DirectionalLight(0xffffff, 1.5);
  light.position.set(-1, 1.5, 2);
  scene.add(file.scene, light, new THREE.HemisphereLight(0xffffff, 0x888888, 2));
  const faces = [];
  let head;
  file.scene.traverse((node) => {
    node.frustumCulled = false;
    if (/Head$/.test(node.userData.name ?? node.name)) head ??= node;
    if (node.morphTargetInfluences) faces.push(node);
  });
  const mixer = new THREE.AnimationMixer(file.scene);
  mixer.clipAction(played ? createVRMAnimationClip(played, vrm) : file.animations[0]).play();
  const camera = new THREE.PerspectiveCamera(15, 1, 0.05, 10);
  return times.map((time) => {
    mixer.setTime(time);
    vrm?.update(0);
    file.scene.updateMatrixWorld(true);
    const at = head.getWorldPosition(new THREE.Vector3()).add(new THREE.Vector3(0, 0.075, 0));
    const ahead = new THREE.Vector3(0, 0, vrm || !file.parser.json.extensions?.VRM ? 0.95 : -0.95);
    camera.position.copy(at).add(ahead);
    camera.lookAt(at);
    renderer.render(scene, camera);
    return { picture: renderer.domElement.toDataURL(), weights: [...faces[0].morphTargetInfluences] };
  });
};`;

const resolveDir = import.meta.dirname;
const bundle = await build({ stdin: { contents: SCRIPT, resolveDir }, bundle: true, write: false, format: 'iife' });
const browser = await launch();
const { page, faults } = await watched(browser);
await page.setContent('<body></body>');
await page.addScriptTag({ content: bundle.outputFiles[0].text });
const times = Array.from({ length: Number(count) }, (_, frame) => frame / Number(fps));
const base64 = (file) => (file === '-' ? null : readFileSync(file).toString('base64'));
const weights = [];
for (let row = 0; 2 * row < files.length; row++) {
  const [model, animation] = files.slice(2 * row, 2 * row + 2).map(base64);
  const shown = await page.evaluate((given) => globalThis.play(...given), [model, animation, times]);
  shown.forEach(({ picture }, frame) => writeFileSync(join(out, `${row}-${frame}.png`), picture.split(',')[1], 'base64'));
  weights.push(shown.map((one) => one.weights));
}
await browser.close();
console.log(JSON.stringify({ weights, faults: faults.filter((line) => !line.includes('GPU stall')) }));
