// What the page's own code makes of an avatar and a scene; bundled by fit.mjs for Node and for Chromium.

import { VRMLoaderPlugin } from '@pixiv/three-vrm';
import { VRMAnimationLoaderPlugin } from '@pixiv/three-vrm-animation';
import { Quaternion, Vector3 } from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { decode } from '../src/bytes.ts';
import { bodyOf, motionOf } from '../src/fit/avatar.ts';
import { fitMotion } from '../src/fit/fit.ts';
import { Person } from '../src/person.ts';

const FINGERS = ['Thumb', 'Index', 'Middle', 'Ring', 'Little'];
const POINTS = ['left', 'right'].flatMap((side) => [`${side}Hand`, ...FINGERS.map((finger) => `${side}${finger}Distal`)]);

/** Wrists and fingertips in every frame, fitted and with rotations alone, and what else fit.mjs prints. */
export async function fitted(avatar, scene, timed) {
  const [vrm, vrma] = [decode(avatar), decode(scene.files.vrma)];
  const alone = await Person.avatar(vrm, vrma, null);
  const person = await Person.avatar(vrm, vrma, scene.fit);
  return {
    points: POINTS,
    fitted: positions(person, scene.report),
    rotations: positions(alone, scene.report),
    beyond: person.fitted.beyond,
    ...(await solved(vrm, vrma, scene.fit, timed)),
  };
}

/** Wrists and fingertips in every frame, from the middle of the shoulders. */
function positions(person, { frames, fps }) {
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

/** The avatar's capsules as the solver sees them, and its time. */
async function solved(vrm, vrma, source, timed) {
  const loader = new GLTFLoader().register((parser) => new VRMLoaderPlugin(parser)).register((parser) => new VRMAnimationLoaderPlugin(parser));
  const body = bodyOf((await loader.parseAsync(vrm.slice().buffer, '')).userData.vrm);
  if (!timed) return { capsules: body.capsules };
  const file = await loader.parseAsync(vrma.slice().buffer, '');
  const motion = await motionOf(file, file.userData.vrmAnimations[0], source);
  const times = Array.from({ length: 5 }, () => {
    const started = performance.now();
    for (const _ of fitMotion(motion, body));
    return performance.now() - started;
  });
  return { capsules: body.capsules, ms: Math.min(...times) };
}
