// How other programs read glTF files. `node gltf.mjs [--times 0,0.5,1] FILE...` prints one line of JSON for each file:
// the Khronos validator's counts and first messages; every joint's position at the given times as three.js plays the
// file; the rotations of a VRM animation's bones as @pixiv/three-vrm-animation reads them.

import { readFileSync } from 'node:fs';
import { validateBytes } from 'gltf-validator';
import { AnimationMixer, Vector3 } from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { VRMAnimationLoaderPlugin } from '@pixiv/three-vrm-animation';

globalThis.self ??= globalThis; // three's loaders need a browser's global object

const files = process.argv.slice(2);
const timesIndex = files.indexOf('--times');
const times = timesIndex < 0 ? [] : files.splice(timesIndex, 2)[1].split(',').map(Number);

for (const file of files) {
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
      positions: times.map((time) => positionsAt(gltf, time)),
      bones: (gltf.userData.vrmAnimations ?? []).map(bonesOf)[0] ?? null,
    }),
  );
}

/** Every node's global position at a time in seconds, by its name in the file. */
function positionsAt(gltf, time) {
  const mixer = new AnimationMixer(gltf.scene);
  mixer.clipAction(gltf.animations[0]).play();
  mixer.setTime(time);
  gltf.scene.updateMatrixWorld(true);
  const positions = {};
  gltf.scene.traverse((node) => {
    if (node.userData.name ?? node.name) positions[node.userData.name ?? node.name] = node.getWorldPosition(new Vector3()).toArray();
  });
  mixer.stopAllAction();
  return positions;
}

/** Every bone's rotations, x y z w frame by frame, and the positions of the hips. */
function bonesOf(animation) {
  const rotations = {};
  for (const [bone, track] of animation.humanoidTracks.rotation) rotations[bone] = [...track.values];
  return { rotations, hips: [...(animation.humanoidTracks.translation.get('hips')?.values ?? [])] };
}
