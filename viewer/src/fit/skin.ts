/**
 * The body of an avatar: capsules of the usual proportions, moved and resized to fit the vertices of its skin. The method of the
 * Python module body/skin, which says what is measured.
 */

import { type Quaternion, Vector3 } from 'three';
import type { FitCapsule } from '../wire.js';
import { type Bone, restPositions, SIDES } from './body.js';
import { type UsualCapsule, statureOf } from './capsules.js';
import { capsules as HANDS, skin as SKIN, skin_surface as POINTS } from './constants.js';
import { clip } from './gaps.js';
import { fitHead, type Shape } from './head.js';
import { around, line, MIN_POINTS, quantile, type SkinPoints, type SurfacePoint } from './points.js';
import { type AvatarSkin, skinSurface } from './skin_surface.js';

const { TRUNK, HEAD, BODY, MEASURES, TRUNK_SIZES } = SKIN;
const { LEAST_AREAS } = POINTS;
const FINGER = new RegExp(`(${HANDS.FINGERS.join('|')})(${HANDS.SEGMENTS.join('|')})$`);

interface Piece extends Shape {
  usual: UsualCapsule;
  /** The number of its bone. */
  bone: number;
}

/** The bones of an avatar as it stands at rest (left +X, up +Y, forward +Z), and what brings each into the T-pose, world axes. */
export interface Standing {
  bones: Bone[];
  toTPose: Quaternion[];
}

/**
 * Capsules in the T-pose, fitted to vertices of an avatar that stands at rest, and its skin;
 * ``usual``: in the T-pose too.
 */
export function fitSkin(
  { bones, toTPose }: Standing, usual: UsualCapsule[], points: SkinPoints,
): { capsules: FitCapsule[]; skin: AvatarSkin | null } {
  const fitting = new Fitting(bones, toTPose, usual, points);
  for (const side of SIDES) fitting.hand(side);
  fitting.limbs();
  fitting.trunk();
  fitting.head();
  return { capsules: fitting.capsules(), skin: fitting.skin() };
}

class Fitting {
  private readonly rest: Vector3[];
  private readonly number: Map<string, number>;
  private readonly pieces: Piece[];
  private readonly height: number;
  private readonly points: SkinPoints;

  constructor(private readonly bones: Bone[], private readonly toTPose: Quaternion[], usual: UsualCapsule[], points: SkinPoints) {
    this.rest = restPositions(bones);
    this.number = new Map(bones.map(({ name }, k) => [name, k]));
    this.height = statureOf(bones);
    const least = new Map(Object.entries(LEAST_AREAS).map(([part, area]) => [part, area * this.height ** 2]));
    this.points = points.withoutDoubtful((bone) => partOf(bones[bone]!.name), least);
    this.pieces = usual.map((one) => {
      const bone = this.number.get(one.bone)!;
      const [start, end] = [one.start, one.end].map((end) => this.fromTPose(new Vector3(...end), bone)) as [Vector3, Vector3];
      return { usual: one, bone, start, end, radii: [...one.radii] };
    });
  }

  /** The capsules as they are now. */
  capsules(): FitCapsule[] {
    return this.pieces.map(({ usual: { isTip, ...usual }, bone, start, end, radii }) => {
      const [from, to] = [start, end].map((end) => end.clone().sub(this.rest[bone]!).applyQuaternion(this.toTPose[bone]!));
      return { ...usual, start: from!.toArray(), end: to!.toArray(), radii };
    });
  }

  /** The skin of hands, head, neck and trunk; null where one of these has none. */
  skin(): AvatarSkin | null {
    const spacing = MEASURES.point_spacing * this.height;
    const surfaceOf = (carriers: number[], isBare: boolean) =>
      skinSurface(this.points, carriers, this.rest, this.toTPose, spacing, isBare);
    const [left, right] = SIDES.map((side) => {
      const hand = new Set([this.number.get(`${side}Hand`)!]);
      this.bones.forEach(({ parent }, k) => hand.has(parent) && hand.add(k));
      return surfaceOf([...hand], true);
    });
    const body = surfaceOf(BODY.flatMap((name) => this.number.get(name) ?? []), false);
    return body && left && right ? { body, hands: [left, right] } : null;
  }

  private fromTPose(point: Vector3, bone: number): Vector3 {
    return point.applyQuaternion(this.toTPose[bone]!.clone().invert()).add(this.rest[bone]!);
  }

  private of(...names: string[]): Vector3[] {
    return this.points.of(names.flatMap((name) => this.number.get(name) ?? []));
  }

  /** Points on the surface that bones carry. */
  private surface(...names: string[]): SurfacePoint[] {
    return this.points.surface(names.flatMap((name) => this.number.get(name) ?? []), MEASURES.point_spacing * this.height);
  }

  private find(key: string): Piece | undefined {
    return this.pieces.find(({ usual }) => usual.key === key);
  }

  // --- limbs, neck, fingers ---

  limbs(): void {
    const arms = this.pieces.filter(({ usual }) => usual.region.endsWith('Arm'));
    scaleOthers(arms, arms.filter((piece) => this.fitLimb(piece, true)));
    const neck = this.find('neck');
    if (neck) this.fitLimb(neck, false);
    for (const side of SIDES) {
      const [shoulder, arm] = [this.find(`${side}Shoulder`), this.find(`${side}UpperArm`)];
      if (!shoulder || !arm) continue;
      const factor = arm.radii[0] / arm.usual.radii[0];
      shoulder.radii = [shoulder.radii[0] * factor, shoulder.radii[1] * factor];
    }
  }

  /** Palms and phalanges; those with too few vertices get the median factor of the others. */
  hand(side: 'left' | 'right'): void {
    const rows = this.pieces.filter(({ usual }) => usual.region === 'hand' && usual.side === side);
    const palms = rows.filter(({ usual }) => /(Palm|Mitten)$/.test(usual.key));
    const fingers = rows.filter(({ usual }) => FINGER.test(usual.key));
    scaleOthers(palms, palms.filter((piece) => !piece.usual.key.includes('Thumb') && this.fitPalm(piece, side)));
    scaleOthers(fingers, fingers.filter((piece) => this.fitPhalanx(piece)));
  }

  /** Vertices around a piece's bone: how far along it, as a fraction, and where across it; null where there are too few. */
  private measured({ start, end, usual }: Piece) {
    const near = this.of(usual.bone);
    const axis = end.clone().sub(start);
    const length = axis.length();
    if (near.length < MIN_POINTS || !(length > 0)) return null;
    axis.divideScalar(length);
    const parts = axis.toArray().map(Math.abs);
    const u = axis.clone().cross(new Vector3().setComponent(parts.indexOf(Math.min(...parts)), 1)).normalize();
    const v = axis.clone().cross(u);
    const seen = near.map((point) => {
      const since = point.clone().sub(start);
      return { along: since.dot(axis) / length, x: since.dot(u), y: since.dot(v) };
    });
    return { axis, length, u, v, seen };
  }

  /** Fit one capsule to the vertices around its bone; arms lie along their bones, from joint to joint (``isCentred``). */
  private fitLimb(piece: Piece, isCentred: boolean): boolean {
    const measured = this.measured(piece);
    if (!measured) return false;
    const { u, v, seen } = measured;
    const rings = Array.from({ length: MEASURES.limb_slices }, (_, k) => (k + 0.5) / MEASURES.limb_slices).flatMap((t) => {
      const inside = seen.filter(({ along }) => Math.abs(along - t) < 0.5 / MEASURES.limb_slices);
      const widest = this.widest(piece, t);
      let found = ring(inside, isCentred);
      if (found && found.radius > widest) found = ring(inside.filter(({ x, y }) => Math.hypot(x, y) < widest), isCentred);
      return found ? [{ t, ...found }] : [];
    });
    if (!rings.length) return false;
    const radii = rings.map(({ radius }) => radius);
    const [first, last] = piece.usual.radii;
    if (rings.at(-1)!.t - rings[0]!.t < MEASURES.taper_span) {
      const factor = quantile(rings.map(({ t, radius }) => radius / (first + t * (last - first))), 0.5);
      piece.radii = [first * factor, last * factor];
      return true;
    }
    const at = (values: number[], t: number) => line(rings.map((one) => one.t), values, t);
    [piece.start, piece.end].forEach((end, t) => {
      end.addScaledVector(u, at(rings.map(({ x }) => x), t)).addScaledVector(v, at(rings.map(({ y }) => y), t));
      piece.radii[t as 0 | 1] = clip(at(radii, t), MEASURES.thin_end * Math.min(...radii), MEASURES.thick_end * Math.max(...radii));
    });
    return true;
  }

  /** The radius at part t of a limb, from which on its vertices are cloth; stout bodies have stout palms. */
  private widest({ usual }: Piece, t: number): number {
    const palms = this.pieces.filter((piece) => /(Palm|Mitten)$/.test(piece.usual.key));
    const factors = palms.map(({ radii, usual }) => (radii[0] + radii[1]) / (usual.radii[0] + usual.radii[1]));
    const stout = factors.length ? quantile(factors, 0.5) : 1;
    return MEASURES.sleeve_radius * Math.max(1, stout) * (usual.radii[0] + t * (usual.radii[1] - usual.radii[0]));
  }

  /** One middle and one radius for a phalanx; the last one ends where its vertices do. */
  private fitPhalanx(piece: Piece): boolean {
    const measured = this.measured(piece);
    if (!measured) return false;
    const { axis, u, v, seen } = measured;
    const isLast = piece.usual.isTip;
    const [first, last] = MEASURES.phalanx_range;
    const found = ring(seen.filter(({ along }) => along > first && (along < last || isLast)));
    if (!found) return false;
    const mean = 0.5 * (piece.usual.radii[0] + piece.usual.radii[1]);
    piece.radii = [(found.radius * piece.usual.radii[0]) / mean, (found.radius * piece.usual.radii[1]) / mean];
    let { length } = measured;
    if (isLast) length = Math.max(Math.max(...seen.map(({ along }) => along)) * length - piece.radii[1], MEASURES.shortest_tip * length);
    piece.start.addScaledVector(u, found.x).addScaledVector(v, found.y);
    piece.end.copy(piece.start).addScaledVector(axis, length);
    return true;
  }

  /** Fit one capsule from wrist to knuckle between the surfaces of the palm. */
  private fitPalm(piece: Piece, side: string): boolean {
    const [index, little] = ['Index', 'Little'].map((finger) => this.number.get(`${side}${finger}Proximal`));
    if (index === undefined || little === undefined) return false;
    const spacing = this.rest[index]!.distanceTo(this.rest[little]!) / 3;
    const axis = piece.end.clone().sub(piece.start);
    const length = axis.length();
    if (!(length > 0)) return false;
    axis.divideScalar(length);
    const up = new Vector3(0, 1, 0).applyQuaternion(this.toTPose[piece.bone]!.clone().invert());
    up.addScaledVector(axis, -up.dot(axis)).normalize();
    const beside = axis.clone().cross(up);
    const seen = this.of(`${side}Hand`).map((point) => {
      const since = point.clone().sub(piece.start);
      return { along: since.dot(axis) / length, height: since.dot(up), beside: Math.abs(since.dot(beside)) };
    });
    const found: [number, number][] = [];
    const { palm_slice_starts: lows, palm_slice_length: long, palm_slice_half_width: wide, surface_shares: shares } = MEASURES;
    const thick = MEASURES.cloth_distance * Math.max(...piece.usual.radii);
    for (const low of lows) {
      const inside = seen
        .filter((one) => one.beside < wide * spacing && one.along >= low && one.along < low + long && Math.abs(one.height) < thick)
        .map(({ height }) => height);
      if (inside.length < MIN_POINTS) return false;
      found.push([quantile(inside, shares[0]), quantile(inside, shares[1])]);
    }
    [piece.start, piece.end].forEach((end, k) => {
      const [bottom, top] = found[k]!;
      piece.radii[k as 0 | 1] = 0.5 * (top - bottom);
      end.addScaledVector(up, 0.5 * (top + bottom));
    });
    return true;
  }

  // --- trunk ---

  /** Chest and belly as three columns each, hips, back and collar. */
  trunk(): void {
    const low = this.rest[0]!.y - (TRUNK_SIZES.hem_drop + MEASURES.hem_margin) * this.height;
    const legs = this.surface('leftUpperLeg', 'rightUpperLeg').filter(({ at }) => at.y > low);
    const points = [...this.surface(...TRUNK), ...legs].map(({ at }) => at);
    if (points.length < MIN_POINTS) return;
    for (const name of ['chest', 'belly']) [0, 1, 2].every((n) => this.fitColumn(this.find(`${name}${n}`), name, n, points));
    const chest = this.find('chest1');
    const factor = chest ? (chest.radii[0] + chest.radii[1]) / (chest.usual.radii[0] + chest.usual.radii[1]) : 1;
    for (const piece of ['back', 'collar0', 'collar1'].map((key) => this.find(key))) {
      // Under the skin of the back: as thick as the chest is, relative to the usual, and as far back.
      if (!piece) continue;
      piece.radii = [piece.radii[0] * factor, piece.radii[1] * factor];
      [piece.start, piece.end].forEach((end, k) => {
        const depth = this.depth(points, end.x, end.y);
        if (depth) end.z = Math.max(depth.back + piece.radii[k]!, Math.min(end.z, depth.front - piece.radii[k]!));
      });
    }
    const hips = this.find('hips');
    [hips?.start, hips?.end].forEach((end, k) => {
      const depth = end && this.depth(points, end.x, end.y);
      if (!hips || !depth) return;
      end.z = 0.5 * (depth.back + depth.front);
      hips.radii[k as 0 | 1] = 0.5 * (depth.front - depth.back);
    });
  }

  /** Back and front of the skin at a place seen from in front; null where there is none. */
  private depth(points: Vector3[], x: number, y: number): { back: number; front: number } | null {
    const near = around(points, x, y, MEASURES.window_half_width * this.height)?.map(({ z }) => z);
    return near ? { back: Math.min(...near), front: Math.max(...near) } : null;
  }

  /** Fit one of three columns (0 on the left, 1 in the middle) with lines through front, back and side. */
  private fitColumn(piece: Piece | undefined, name: string, n: number, points: Vector3[]): boolean {
    if (!piece) return true;
    const middle = 0.5 * SIDES.reduce((sum, side) => sum + this.rest[this.number.get(`${side}UpperArm`)!]!.x, 0);
    const rows: { t: number; x: number; back: number; front: number }[] = [];
    for (let k = 0; k < MEASURES.column_heights; k++) {
      const t = k / (MEASURES.column_heights - 1);
      const y = piece.start.y + t * (piece.end.y - piece.start.y);
      const level = points.filter((point) => Math.abs(point.y - y) < MEASURES.level_distance * this.height);
      if (level.length < MIN_POINTS) continue;
      const wide = quantile(level.map(({ x }) => Math.abs(x - middle)), MEASURES.width_share);
      const depth = this.depth(points, middle + (1 - n) * MEASURES.depth_offset * wide, y);
      if (!depth) continue;
      const out = clip(wide - 0.5 * (depth.front - depth.back), MEASURES.least_column_offset * wide, MEASURES.largest_column_offset * wide);
      rows.push({ t, x: middle + (1 - n) * out, ...depth });
    }
    if (rows.length < MEASURES.least_heights) return false;
    const weights = rows.map(({ t }) => (name === 'belly' || t < MEASURES.lower_chest ? 1 : MEASURES.lower_chest_weight));
    [piece.start, piece.end].forEach((end, at) => {
      const [x, back, front] = (['x', 'back', 'front'] as const).map((what) => line(rows.map(({ t }) => t), rows.map((row) => row[what]), at, weights));
      end.x = x!;
      end.z = 0.5 * (back! + front!);
      piece.radii[at as 0 | 1] = 0.5 * (front! - back!);
    });
    return true;
  }

  head(): void {
    const pieces = this.pieces.filter(({ usual }) => usual.key.startsWith('head'));
    const joint = pieces.length ? this.rest[pieces[0]!.bone]! : new Vector3();
    const points = this.surface(...HEAD).map(({ at }) => at.clone().sub(joint));
    const shapes = pieces.map<Shape>(({ start, end, radii }) => ({ start: start.clone().sub(joint), end: end.clone().sub(joint), radii: [...radii] }));
    if (!shapes.length || !fitHead(shapes, points, this.height)) return;
    pieces.forEach((piece, k) => {
      const { start, end, radii } = shapes[k]!;
      Object.assign(piece, { start: start.add(joint), end: end.add(joint), radii });
    });
  }
}

/** The part of the body, of ``LEAST_AREAS``, to which a bone belongs. */
function partOf(name: string): string {
  if (name in LEAST_AREAS) return name;
  if ((HEAD as readonly string[]).includes(name)) return 'head';
  if ((TRUNK as readonly string[]).includes(name)) return 'chest';
  return (name.startsWith('left') ? 'left' : 'right') + (name.endsWith('Toes') ? 'Foot' : 'Fingers');
}

/**
 * Middle and radius of the vertices around a bone; null where they are too few, or not all around. The middle is the bone itself
 * where that is wanted (``isCentred``).
 */
function ring(points: { x: number; y: number }[], isCentred = false): { x: number; y: number; radius: number } | null {
  const quarters = new Set(points.map(({ x, y }) => `${x > 0} ${y > 0}`));
  if (points.length < MIN_POINTS || quarters.size < 4) return null;
  const [low, high] = MEASURES.surface_shares;
  const middle = (values: number[]) => (isCentred ? 0 : 0.5 * (quantile(values, low) + quantile(values, high)));
  const [x, y] = [middle(points.map((point) => point.x)), middle(points.map((point) => point.y))];
  return { x, y, radius: quantile(points.map((point) => Math.hypot(point.x - x, point.y - y)), 0.5) };
}

/** Give the pieces that were not fitted the median factor of those that were. */
function scaleOthers(pieces: Piece[], fitted: Piece[]): void {
  if (!fitted.length) return;
  const factor = quantile(fitted.map(({ radii, usual }) => (radii[0] + radii[1]) / (usual.radii[0] + usual.radii[1])), 0.5);
  for (const piece of pieces) if (!fitted.includes(piece)) piece.radii = [piece.radii[0] * factor, piece.radii[1] * factor];
}
