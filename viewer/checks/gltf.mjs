// What others make of the files that we write. `node gltf.mjs FILE...` prints a JSON object for each, a line each:
// the Khronos validator's counts and first messages; every joint's place at given moments as three.js plays the file
// (--times 0,0.5,1); the turns of a VRM animation's bones as @pixiv/three-vrm-animation reads them.

import { readFileSync } from 'node:fs';
import { validateBytes } from 'gltf-validator';
import { AnimationMixer, Vector3 } from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { VRMAnimationLoaderPlugin } from '@pixiv/three-vrm-animation';

globalThis.self ??= globalThis; // three's loaders ask for a browser's global object

const given = process.argv.slice(2);
const timesAt = given.indexOf('--times');
const times = timesAt < 0 ? [] : given.splice(timesAt, 2)[1].split(',').map(Number);

for (const file of given) {
  const bytes = new Uint8Array(readFileSync(file));
  const { issues } = await validateBytes(bytes);
  const loader = new GLTFLoader().register((parser) => new VRMAnimationLoaderPlugin(parser));
  const gltf = await loader.parseAsync(bytes.buffer, '');
  console.log(
    JSON.stringify({
      file,
      errors: issues.numErrors,
      warnings: issues.numWarnings,
      messages: issues.messages.slice(0, 20).map(({ code, message, pointer }) => `${code} ${pointer}: ${message}`),
      places: times.map((time) => placesAt(gltf, time)),
      bones: (gltf.userData.vrmAnimations ?? []).map(bonesOf)[0] ?? null,
    }),
  );
}

/** Every node's place in the world at a moment, by name as the file has it. */
function placesAt(gltf, time) {
  const mixer = new AnimationMixer(gltf.scene);
  mixer.clipAction(gltf.animations[0]).play();
  mixer.setTime(time);
  gltf.scene.updateMatrixWorld(true);
  const places = {};
  gltf.scene.traverse((node) => {
    if (node.userData.name ?? node.name) places[node.userData.name ?? node.name] = node.getWorldPosition(new Vector3()).toArray();
  });
  mixer.stopAllAction();
  return places;
}

/** Every bone's turns, x y z w frame by frame, and the way of the hips. */
function bonesOf(animation) {
  const turns = {};
  for (const [bone, track] of animation.humanoidTracks.rotation) turns[bone] = [...track.values];
  return { turns, hips: [...(animation.humanoidTracks.translation.get('hips')?.values ?? [])] };
}
