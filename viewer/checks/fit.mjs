// How the page's own code fits motion to avatars, without a browser. `node fit.mjs CASES.json` reads a list of
// {avatar: FILE.vrm, scene: a wire.Spliced} and prints a line of JSON for each: wrists and fingertips in every frame, fitted
// and with rotations alone (m, from the middle of the shoulders), what the page would warn of, and the solver's time.

import { readFileSync } from 'node:fs';
import { dirname, join } from 'node:path';
import { fileURLToPath } from 'node:url';
import { build } from 'esbuild';

globalThis.self ??= globalThis; // three's loaders need a browser's global object

const source = join(dirname(fileURLToPath(import.meta.url)), '../src');
const bundle = await build({
  stdin: {
    contents: `
      export { Person } from './person.js';
      export { bodyOf, motionOf } from './fit/avatar.js';
      export { fitMotion } from './fit/fit.js';
      export { VRMLoaderPlugin } from '@pixiv/three-vrm';
      export { VRMAnimationLoaderPlugin } from '@pixiv/three-vrm-animation';
      export { Quaternion, Vector3 } from 'three';
      export { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
    `,
    resolveDir: source,
    loader: 'ts',
  },
  bundle: true,
  write: false,
  format: 'esm',
  target: 'es2022',
  logLevel: 'error',
});
const code = `data:text/javascript;base64,${Buffer.from(bundle.outputFiles[0].contents).toString('base64')}`;
const { Person, bodyOf, motionOf, fitMotion, VRMLoaderPlugin, VRMAnimationLoaderPlugin, Quaternion, Vector3, GLTFLoader } =
  await import(code);

const FINGERS = ['Thumb', 'Index', 'Middle', 'Ring', 'Little'];
const POINTS = ['left', 'right'].flatMap((side) => [`${side}Hand`, ...FINGERS.map((finger) => `${side}${finger}Distal`)]);

for (const { avatar, scene } of JSON.parse(readFileSync(process.argv[2], 'utf8'))) {
  const vrm = new Uint8Array(readFileSync(avatar));
  const vrma = new Uint8Array(Buffer.from(scene.files.vrma, 'base64'));
  const [alone, fitted] = [await Person.avatar(vrm, vrma, null), await Person.avatar(vrm, vrma, scene.fit)];
  console.log(
    JSON.stringify({
      points: POINTS,
      fitted: positions(fitted, scene.report),
      rotations: positions(alone, scene.report),
      beyond: fitted.fitted.beyond,
      ...(await solved(vrm, vrma, scene.fit)),
    }),
  );
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

/** The avatar's capsules as the solver sees them, and its time for all frames, ms: the second run's, when the code is warm. */
async function solved(vrm, vrma, source) {
  const loader = new GLTFLoader().register((parser) => new VRMLoaderPlugin(parser)).register((parser) => new VRMAnimationLoaderPlugin(parser));
  const [avatar, motion] = [await loader.parseAsync(vrm.slice().buffer, ''), await loader.parseAsync(vrma.slice().buffer, '')];
  const [body, signed] = [bodyOf(avatar.userData.vrm), await motionOf(motion, motion.userData.vrmAnimations[0], source)];
  const times = [0, 1].map(() => {
    const started = performance.now();
    for (const _ of fitMotion(signed, body));
    return performance.now() - started;
  });
  return { capsules: body.capsules, ms: times[1] };
}
