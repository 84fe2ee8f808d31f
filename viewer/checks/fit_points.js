// What the page's own code makes of an avatar and a scene; bundled by fit.mjs for Node and for Chromium.

import { VRMAnimationLoaderPlugin } from '@pixiv/three-vrm-animation';
import { Quaternion, Vector3 } from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { decode } from '../src/bytes.ts';
import { bodyOf, motionOf } from '../src/fit/avatar.ts';
import { fitMotion } from '../src/fit/fit.ts';
import { readAvatar } from '../src/humanoid.ts';
import { personOf, sourceOf } from '../src/source.ts';

const FINGERS = ['Thumb', 'Index', 'Middle', 'Ring', 'Little'];
const POINTS = ['left', 'right'].flatMap((side) => [`${side}Hand`, ...FINGERS.map((finger) => `${side}${finger}Distal`)]);

/** What fit.mjs prints of a .vrm in base64 and a scene. */
export async function fitted(avatar, scene, timed) {
  const person = await personOf(sourceOf(scene), decode(avatar));
  const { frames, fps } = scene.report;
  const body = await bodyIn(avatar);
  const ms = timed ? await time(body, decode(scene.files.vrma), scene.fit) : null;
  return { points: POINTS, hands: positions(person, frames, fps), beyond: person.fitted.beyond, capsules: body.capsules, ms };
}

/** Wrists and fingertips in every frame, from the middle of the shoulders. */
function positions(person, frames, fps) {
  const { humanoid } = person.vrm;
  const at = (name) => humanoid.getRawBoneNode(name)?.getWorldPosition(new Vector3());
  return Array.from({ length: frames }, (_, frame) => {
    person.at(frame / fps);
    const middle = at('leftUpperArm').add(at('rightUpperArm')).divideScalar(2);
    return POINTS.map((name) => {
      const point = at(name)?.sub(middle);
      if (!point) return null;
      if (name.endsWith('Distal')) {
        // Where a finger ends is not said in the file: 0.8 of the phalanx before, straight on.
        const bone = new Vector3(...humanoid.normalizedRestPose[name].position);
        point.addScaledVector(bone.applyQuaternion(humanoid.getNormalizedBoneNode(name).getWorldQuaternion(new Quaternion())), 0.8);
      }
      return point.toArray();
    });
  });
}

const loader = new GLTFLoader().register((parser) => new VRMAnimationLoaderPlugin(parser));
const bodies = new Map();

/** The body of the avatar in a .vrm, as the solver sees it. */
async function bodyIn(avatar) {
  if (!bodies.has(avatar)) {
    bodies.set(avatar, bodyOf(...(await readAvatar(decode(avatar)))));
  }
  return bodies.get(avatar);
}

/** How long the solver takes for all frames, ms. */
async function time(body, vrma, source) {
  const file = await loader.parseAsync(vrma.buffer, '');
  const motion = await motionOf(file, file.userData.vrmAnimations[0], source);
  const times = Array.from({ length: 5 }, () => {
    const started = performance.now();
    for (const _ of fitMotion(motion, body));
    return performance.now() - started;
  });
  return Math.min(...times);
}
