/** The 3-D view: light, floor, camera, and one signer or two side by side. */

import {
  Box3,
  CircleGeometry,
  Color,
  DirectionalLight,
  HemisphereLight,
  Mesh,
  PCFShadowMap,
  PerspectiveCamera,
  Scene,
  ShadowMaterial,
  Vector2,
  Vector3,
  WebGLRenderer,
} from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';
import type { Person } from './person.js';

export type View = 'front' | 'side' | 'hands';

const BACKGROUND = new Color('#dde3e6');
const FOV_DEG = 26; // a long lens, for little distortion of hands near the camera
/** Signing space that has to be visible, as fractions of stature; TOP is its upper end. */
const SPACE = { width: 0.8, height: 0.6 };
const TOP = 1.07;
const RAISED = 0.58; // height above which a hand is raised
const HANDS = { width: 0.42, height: 0.34 };
const FOLLOW_S = 0.12; // time constant of the camera that follows the hands

export class Stage {
  readonly renderer: WebGLRenderer;
  private readonly camera = new PerspectiveCamera(FOV_DEG, 1, 0.05, 50);
  private readonly controls: OrbitControls;
  private readonly scenes: Scene[] = [];
  private people: Person[] = [];
  private view: View = 'front';
  private stature = 1.7;
  private follows: Vector3 | null = null;
  private isFilming = false; // in the film's size, not the page's

  constructor(private readonly canvas: HTMLCanvasElement, private readonly changed: () => void) {
    this.renderer = new WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = PCFShadowMap;
    this.renderer.setScissorTest(true);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = false;
    this.controls.minDistance = 0.3;
    this.controls.maxDistance = 12;
    this.controls.addEventListener('change', changed);
    this.controls.addEventListener('start', () => (this.follows = null));
  }

  /** Show one person, or two to compare. The camera stays where the user left it if the number and size are the same. */
  show(people: Person[]): void {
    for (const person of this.people) person.dispose();
    const same = this.people.length === people.length;
    this.people = people;
    for (const scene of this.scenes) drop(scene);
    this.scenes.length = 0;
    for (const person of people) this.scenes.push(lit(person));
    const height = new Box3().setFromObject(people[0]!.root, true).max.y;
    const changed = Math.abs(height - this.stature) > 0.1 * this.stature;
    this.stature = Number.isFinite(height) && height > 0.2 ? height : 1.7;
    if (!same || changed) this.look(this.view);
    else this.changed();
  }

  look(view: View): void {
    this.view = view;
    const hands = view === 'hands' ? this.hands() : null;
    this.follows = hands;
    const tall = this.tall(view === 'hands' ? HANDS : SPACE);
    // A narrow picture has height to spare, which goes below the hands.
    const target = hands ?? new Vector3(0, TOP * this.stature - tall / 2, 0);
    const direction = view === 'side' ? new Vector3(1, 0.04, 0.12) : new Vector3(0, 0.04, 1);
    const distance = tall / 2 / Math.tan((FOV_DEG * Math.PI) / 360) + 0.12 * this.stature;
    this.camera.position.copy(target).addScaledVector(direction.normalize(), distance);
    this.controls.target.copy(target);
    this.controls.update();
    this.changed();
  }

  private hands(): Vector3 | null {
    return this.people[0]?.handsAt(RAISED * this.stature) ?? null;
  }

  /** Height of a side's picture in metres, so that the given space fits into it. */
  private tall({ width, height }: { width: number; height: number }): number {
    const { clientWidth, clientHeight } = this.canvas;
    const aspect = clientWidth / Math.max(1, this.people.length) / Math.max(1, clientHeight) || 1;
    return this.stature * Math.max(height, width / aspect);
  }

  /** Move the camera with the hands, if it follows them. */
  follow(seconds: number): void {
    const hands = this.follows && this.hands();
    if (!hands) return;
    const fraction = seconds > 0 ? 1 - Math.exp(-seconds / FOLLOW_S) : 1;
    const offset = hands.sub(this.controls.target).multiplyScalar(fraction);
    this.controls.target.add(offset);
    this.camera.position.add(offset);
    this.controls.update();
  }

  /** Fit the picture to its element on the page. */
  resize(): void {
    const { clientWidth, clientHeight } = this.canvas;
    if (!clientWidth || !clientHeight || this.isFilming) return;
    this.renderer.setPixelRatio(Math.min(2, window.devicePixelRatio));
    this.renderer.setSize(clientWidth, clientHeight, false);
    this.look(this.view);
  }

  draw(): void {
    const size = this.renderer.getSize(new Vector2());
    const wide = size.x / Math.max(1, this.scenes.length);
    this.camera.aspect = wide / size.y;
    this.camera.updateProjectionMatrix();
    this.scenes.forEach((scene, k) => {
      this.renderer.setViewport(k * wide, 0, wide, size.y);
      this.renderer.setScissor(k * wide, 0, wide, size.y);
      this.renderer.render(scene, this.camera);
    });
  }

  /** Run ``work`` with the picture in another size, for a film; then restore the page's size. */
  async sized(width: number, height: number, work: () => Promise<void>): Promise<void> {
    const ratio = this.renderer.getPixelRatio();
    this.renderer.setPixelRatio(1);
    this.renderer.setSize(width, height, false);
    this.isFilming = true;
    try {
      await work();
    } finally {
      this.isFilming = false;
      this.renderer.setPixelRatio(ratio);
      this.renderer.setSize(this.canvas.clientWidth, this.canvas.clientHeight, false);
      this.changed();
    }
  }
}

/** Free what a scene holds besides its person. */
function drop(scene: Scene): void {
  scene.traverse((node) => {
    if (node instanceof DirectionalLight) node.dispose();
    if (node instanceof Mesh) {
      node.geometry.dispose();
      for (const material of [node.material].flat()) material.dispose();
    }
  });
}

/** A person in even light from the front, with a shadow that shows how far hands are from the body. */
function lit(person: Person): Scene {
  const scene = new Scene();
  scene.background = BACKGROUND;
  scene.add(person.root, new HemisphereLight('#ffffff', '#b9b2a8', 2.1));
  const key = new DirectionalLight('#fff6ea', 1.9);
  key.position.set(-1.3, 3.2, 3.4);
  key.target.position.set(0, 1.1, 0);
  key.castShadow = true;
  key.shadow.mapSize.set(2048, 2048);
  Object.assign(key.shadow.camera, { left: -1.1, right: 1.1, top: 1.2, bottom: -1.4, near: 1, far: 8 });
  key.shadow.bias = -0.0004;
  key.shadow.normalBias = 0.008;
  key.shadow.radius = 4;
  const floor = new Mesh(new CircleGeometry(1.6, 48).rotateX(-Math.PI / 2), new ShadowMaterial({ opacity: 0.18 }));
  floor.receiveShadow = true;
  scene.add(key, key.target, floor);
  return scene;
}
