// Prints as JSON how three-vrm turns eyes and jaw, relative to the head, at the end of animations: yaw and pitch in
// degrees. Arguments: avatar and animation, in turn.
import { readFileSync } from 'node:fs'

globalThis.self = globalThis
const THREE = await import('three')
const { GLTFLoader } = await import('three/examples/jsm/loaders/GLTFLoader.js')
const { VRMLoaderPlugin } = await import('@pixiv/three-vrm')
const animations = await import('@pixiv/three-vrm-animation')

async function load(file) {
  const loader = new GLTFLoader()
  loader.register((parser) => new VRMLoaderPlugin(parser))
  loader.register((parser) => new animations.VRMAnimationLoaderPlugin(parser))
  return (await loader.parseAsync(Uint8Array.from(readFileSync(file)).buffer, '')).userData
}

const found = []
for (let n = 2; n < process.argv.length; n += 2) {
  const { vrm } = await load(process.argv[n])
  const [animation] = (await load(process.argv[n + 1])).vrmAnimations
  const proxy = new animations.VRMLookAtQuaternionProxy(vrm.lookAt)
  proxy.name = 'look-at'
  vrm.scene.add(proxy)
  const clip = animations.createVRMAnimationClip(animation, vrm)
  const mixer = new THREE.AnimationMixer(vrm.scene)
  mixer.clipAction(clip).play()
  mixer.setTime(clip.duration - 1e-6)
  vrm.update(0)
  vrm.scene.updateMatrixWorld(true)
  const world = (bone) => vrm.humanoid.getRawBoneNode(bone).getWorldQuaternion(new THREE.Quaternion())
  const head = world('head').invert()
  const rows = {}
  for (const bone of ['leftEye', 'rightEye', 'jaw']) {
    const angles = new THREE.Euler().setFromQuaternion(head.clone().multiply(world(bone)), 'YXZ')
    rows[bone] = [angles.y, angles.x].map(THREE.MathUtils.radToDeg)
  }
  found.push(rows)
}
console.log(JSON.stringify(found))
