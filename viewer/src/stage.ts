/** The 3-D view: light, floor, camera, and one signer or two side by side. */

import {
  Box3,
  CircleGeometry,
  Color,
  DirectionalLight,
  HemisphereLight,
  MathUtils,
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
import type { View } from './api.js';
import type { Person } from './person.js';

const FOV_DEG = 26; // a long lens, for little distortion of hands near the camera
/** Signing space that has to be visible, head to hips, as fractions of stature; TOP is its upper end. In the words that ship
 * hands reach 0.2 to either side of the middle, and elbows 0.22 in nine words of ten.
 */
const SPACE = { width: 0.52, height: 0.6 };
const TOP = 1.07;
const RAISED = 0.58; // height above which a hand is raised
const HANDS = { width: 0.21, height: 0.17 }; // of one hand, or of two beside one another; hands apart add their distance
/** What is drawn, from the best to the fastest: pixels for each of the page's, whether with shadows, and how far apart frames
 * may come before the next is chosen, seconds. The figure itself stays whole, since handshapes carry meaning.
 */
const DETAILS = [
  { ratio: 3, hasShadows: true, late: 1 / 20 },
  { ratio: 1.5, hasShadows: false, late: 1 / 10 },
  { ratio: 1, hasShadows: false, late: Infinity },
] as const;
const SMOOTH = 2; // pixels for each of the page's that smooth edges: in software it costs less than multisampling
const FOLLOW_S = 0.12; // time constant of the camera that follows the hands
const ZOOM_S = 0.4; // time constant of its distance

export class Stage {
  readonly renderer: WebGLRenderer;
  private readonly camera = new PerspectiveCamera(FOV_DEG, 1, 0.05, 50);
  private readonly controls: OrbitControls;
  private readonly scenes: Scene[] = [];
  private people: Person[] = [];
  private view: View = 'front';
  private stature = 1.7;
  private follows = false;
  private isFilming = false; // in the film's size, not the page's
  private detail = 0; // number in DETAILS
  private readonly background = new Color();

  /** ``changed`` is called when there is something new to draw. Throws where the browser has no WebGL. */
  constructor(private readonly canvas: HTMLCanvasElement, private readonly changed: () => void) {
    this.renderer = new WebGLRenderer({ canvas, preserveDrawingBuffer: true });
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = PCFShadowMap;
    this.renderer.setScissorTest(true);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.enableDamping = false;
    this.controls.minDistance = 0.3;
    this.controls.maxDistance = 12;
    this.controls.addEventListener('change', changed);
    this.controls.addEventListener('start', () => (this.follows = false));
    this.isMovable = false;
  }

  /** Whether the user can turn and move the camera; else the canvas scrolls with its page. */
  set isMovable(on: boolean) {
    this.controls.enabled = on;
    this.canvas.style.touchAction = on ? 'none' : 'auto';
  }

  /** Free what the renderer and the people hold. */
  dispose(): void {
    for (const person of this.people) person.dispose();
    this.controls.dispose();
    this.renderer.dispose();
    this.renderer.forceContextLoss();
  }

  /** Show one person, or two to compare. The camera stays where the user left it if the number and size are the same. */
  show(people: Person[]): void {
    for (const person of this.people) person.dispose();
    const same = this.people.length === people.length;
    this.people = people;
    for (const scene of this.scenes) drop(scene);
    this.scenes.length = 0;
    for (const person of people) this.scenes.push(lit(person, this.background));
    const height = new Box3().setFromObject(people[0]!.root, true).max.y;
    const changed = Math.abs(height - this.stature) > 0.1 * this.stature;
    this.stature = Number.isFinite(height) && height > 0.2 ? height : 1.7;
    this.setShadows(this.drawn.hasShadows);
    if (!same || changed) this.look(this.view);
    else this.changed();
  }

  look(view: View): void {
    this.view = view;
    const hands = view === 'hands' ? this.hands() : null;
    this.follows = hands !== null;
    const tall = this.tall(SPACE);
    // A narrow picture has height to spare, which goes below the hands.
    const target = hands?.centre ?? new Vector3(0, TOP * this.stature - tall / 2, 0);
    const direction = view === 'side' ? new Vector3(1, 0.04, 0.12) : new Vector3(0, 0.04, 1);
    const distance = hands?.distance ?? this.distance(tall);
    this.camera.position.copy(target).addScaledVector(direction.normalize(), distance);
    this.controls.target.copy(target);
    this.controls.update();
    this.changed();
  }

  /** Where the camera has to look, and from how far, to show the hands. */
  private hands(): { centre: Vector3; distance: number } | null {
    const box = this.people[0]?.handsAt(RAISED * this.stature);
    if (!box) return null;
    const apart = box.getSize(new Vector3()).divideScalar(this.stature);
    const tall = this.tall({ width: HANDS.width + apart.x, height: HANDS.height + apart.y });
    return { centre: box.getCenter(new Vector3()), distance: this.distance(tall) };
  }

  /** How far away the camera shows a height in metres. */
  private distance(tall: number): number {
    return tall / 2 / Math.tan((FOV_DEG * Math.PI) / 360) + 0.12 * this.stature;
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
    const part = (constant: number) => (seconds > 0 ? 1 - Math.exp(-seconds / constant) : 1);
    const { target } = this.controls;
    const away = this.camera.position.clone().sub(target);
    away.setLength(MathUtils.lerp(away.length(), hands.distance, part(ZOOM_S)));
    target.lerp(hands.centre, part(FOLLOW_S));
    this.camera.position.copy(target).add(away);
    this.controls.update();
  }

  /** Fit the picture to its element on the page. */
  resize(): void {
    const { clientWidth, clientHeight } = this.canvas;
    if (!clientWidth || !clientHeight || this.isFilming) return;
    this.fit();
    this.look(this.view);
  }

  private fit(): void {
    this.renderer.setPixelRatio(Math.min(this.drawn.ratio, Math.max(SMOOTH, window.devicePixelRatio)));
    this.renderer.setSize(this.canvas.clientWidth, this.canvas.clientHeight, false);
  }

  private get drawn() {
    return DETAILS[this.detail]!;
  }

  /** Frames that come further apart than this, seconds, are late. */
  get late(): number {
    return this.drawn.late;
  }

  /** Draw less from now on, since frames come late. */
  lighten(): void {
    this.detail = Math.min(this.detail + 1, DETAILS.length - 1);
    this.canvas.dataset['detail'] = String(this.detail);
    this.fit();
    this.setShadows(this.drawn.hasShadows);
    this.changed();
  }

  private setShadows(on: boolean): void {
    for (const scene of this.scenes) scene.traverse((node) => node instanceof DirectionalLight && (node.castShadow = on));
  }

  draw(): void {
    this.background.setStyle(getComputedStyle(this.canvas).backgroundColor);
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
    this.renderer.setPixelRatio(SMOOTH);
    this.renderer.setSize(width, height, false);
    this.setShadows(true); // a film takes its time
    this.isFilming = true;
    try {
      await work();
    } finally {
      this.isFilming = false;
      this.fit();
      this.setShadows(this.drawn.hasShadows);
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
function lit(person: Person, background: Color): Scene {
  const scene = new Scene();
  scene.background = background;
  scene.add(person.root, new HemisphereLight('#ffffff', '#b9b2a8', 2.1));
  const key = new DirectionalLight('#fff6ea', 1.9);
  key.position.set(-1.3, 3.2, 3.4);
  key.target.position.set(0, 1.1, 0);
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
