/** The capsules of an avatar's head, fitted to the vertices of its face and skull: the method of the Python module body/skin. */

import type { Vector3 } from 'three';
import { skin as SKIN } from './constants.js';
import { clip } from './gaps.js';
import { MIN_POINTS, quantile } from './points.js';

const { HEAD_MEASURES: HEAD, MEASURES, BALLS, PROFILE } = SKIN;

/** A capsule while it is fitted: ends in the rest pose (left +X, up +Y, forward +Z) and radii, m. */
export interface Shape {
  start: Vector3;
  end: Vector3;
  radii: [number, number];
}

interface Ball {
  x: number;
  y: number;
  z: number;
  radius: number;
}

/** Fit the head's capsules of the usual proportions in place, all about its joint; false where there are too few vertices. */
export function fitHead(shapes: Shape[], points: Vector3[], height: number): boolean {
  if (points.length < HEAD.vertex_multiple * MIN_POINTS) return false;
  const [foremost, hindmost] = [1, -1].map((sign) => outermost(points, sign, HEAD.map_cell * height)) as [Vector3[], Vector3[]];
  const depth = Math.max(...foremost.map(({ z }) => z));
  const front = foremost.filter(({ z }) => z > HEAD.face_depth * depth);
  const wide = front.length ? quantile(front.map(({ x }) => Math.abs(x)), MEASURES.width_share) : 0;
  const jaw = front.filter(({ x, z }) => z > HEAD.jaw_depth * depth && Math.abs(x) < HEAD.jaw_half_width * wide);
  if (jaw.length < MIN_POINTS) return false;
  const low = Math.min(...jaw.map(({ y }) => y));
  const xScale = wide / (HEAD.face_half_width * height);
  const span = (HEAD.top_height - HEAD.chin_height) * height;
  const highest = points.reduce((most, { y }) => Math.max(most, y), -Infinity);
  const yScale = clip((highest - low) / span, HEAD.least_tallness * xScale, HEAD.largest_tallness * xScale);
  const top = low + yScale * span;
  for (const { start, end, radii } of shapes) {
    for (const point of [start, end]) point.set(point.x * xScale, low + yScale * (point.y - HEAD.chin_height * height), point.z * xScale);
    radii[0] *= xScale;
    radii[1] *= xScale;
  }
  const [face, chin, nose, skull] = [BALLS.face, BALLS.chin, BALLS.nose, BALLS.skull].map((row) => shapes[row]!) as [Shape, Shape, Shape, Shape];
  skull.start.y = top - skull.radii[0];
  const template = [...between(face), ...between(chin)];
  const usualMiddle = 0.5 * (face.start.z + face.end.z);
  const tall = yScale * height;
  for (const [name, end, half] of PROFILE) {
    const point = shapes[BALLS[name]]![end ? 'end' : 'start'];
    // Less is wanted from below, where the surface of a chin recedes.
    const isNear = (above: number) => above > -HEAD.distance_below * half * tall && above < half * tall;
    const near = foremost.filter(({ x, y }) => isNear(y - point.y) && Math.abs(x) < HEAD.distance_beside * wide);
    point.z += offset(near, template, 1) ?? 0;
  }
  const shift = 0.5 * (face.start.z + face.end.z) - usualMiddle;
  const found = offset(hindmost.filter(({ x }) => Math.abs(x) < HEAD.distance_beside * wide), between(skull), -1);
  // A head that is open behind, under hair that does not count, has only the inside of its face there.
  const by = found === null || found > shift + HEAD.open_distance * skull.radii[0] ? shift : found;
  skull.start.z += by;
  skull.end.z += by;
  placeNose(nose, foremost, low, top, wide);
  return true;
}

/** Put the nose's capsule below the foremost point of the middle of the face. */
function placeNose(nose: Shape, front: Vector3[], chin: number, top: number, wide: number): void {
  const { nose_half_width: beside, lowest_nose: low, highest_nose: high, bridge_distance: near } = HEAD;
  const middle = front.filter(({ x, y }) => {
    const share = (y - chin) / (top - chin);
    return Math.abs(x) < beside * wide && share > low && share < high;
  });
  if (!middle.length) return;
  const tip = middle.reduce((best, point) => (point.z > best.z ? point : best));
  const rise = nose.start.y - nose.end.y;
  nose.end.set(0, tip.y, tip.z - nose.radii[1]);
  const bridge = middle.filter(({ y }) => Math.abs(y - tip.y - rise) < near * rise);
  const z = bridge.length ? Math.max(...bridge.map((point) => point.z)) : tip.z;
  nose.start.set(0, tip.y + rise, z - nose.radii[0]);
}

/** Of the points in each square cell of the plane of x and y, the one farthest in front, or behind with ``sign`` -1. */
function outermost(points: Vector3[], sign: number, cell: number): Vector3[] {
  const found = new Map<string, Vector3>();
  for (const point of points) {
    const key = `${Math.floor(point.x / cell)} ${Math.floor(point.y / cell)}`;
    const other = found.get(key);
    if (!other || sign * point.z > sign * other.z) found.set(key, point);
  }
  return [...found.values()];
}

/** Balls along a capsule. */
function between({ start, end, radii }: Shape): Ball[] {
  return Array.from({ length: HEAD.capsule_balls }, (_, k) => k / (HEAD.capsule_balls - 1)).map((t) => ({ ...start.clone().lerp(end, t), radius: radii[0] + t * (radii[1] - radii[0]) }));
}

/**
 * The median distance in z by which a surface lies beyond the outermost of some balls, seen from in front, or from behind with
 * ``sign`` -1; null where they do not overlap.
 */
function offset(surface: Vector3[], balls: Ball[], sign: number): number | null {
  const beyond: number[] = [];
  for (const point of surface) {
    let outer = -Infinity;
    for (const { x, y, z, radius } of balls) {
      const squared = radius * radius - (point.x - x) ** 2 - (point.y - y) ** 2;
      if (squared > HEAD.rim_share * radius * radius) outer = Math.max(outer, sign * z + Math.sqrt(squared));
    }
    if (outer > -Infinity) beyond.push(sign * point.z - outer);
  }
  return beyond.length < MIN_POINTS ? null : sign * quantile(beyond, 0.5);
}
