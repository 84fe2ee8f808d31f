// Generated from the service's wire.py; do not edit.

export type Format = "bvh" | "glb" | "vrma" | "pose";

export const MEDIA_TYPES: Record<Format, string> = {
  bvh: 'text/plain; charset=utf-8',
  glb: 'model/gltf-binary',
  vrma: 'model/gltf-binary',
  pose: 'application/x-pose',
};

/** A token of a line of glosses, and how it is signed. */
export interface SentenceToken {
  token: string;
  glosses: string[];
  spelled: boolean;
  warning: string;
  note: string;
  suggestions: string[];
  pause: string;
  language: string;
}

/** Joints of a sign's span that do not show its clip: those of channels that the word does not own, the fingers of a spelled letter that are on their way, the arm of one that slides. */
export interface Remade {
  joints: string[];
  frames: [number, number];
}

/** Frames of a transition's or a retraction's span in which the sign before it is held in its last posture. */
export interface Pause {
  mark: string;
  frames: [number, number];
}

/** Where a stretch of the output comes from; frame ranges are half-open. */
export interface Span {
  kind: "sign" | "transition" | "retraction";
  clip: number | null;
  name: string | null;
  source: [number, number] | null;
  output: [number, number];
  warp: [number, number][] | null;
  remade: Remade | null;
  pause: Pause | null;
}

/** How good a seam is: its row in the result and in the report. */
export interface Seam {
  before: string;
  after: string;
  pre_frame: number;
  post_frame: number;
  n_transition: number;
  seconds: number;
  velocity_jump: number | null;
  peak_speed_m_s: number | null;
  jerk_ratio: number | null;
  warnings: string[];
  intrusion_mm: number | null;
}

/** The tempo of a sentence. */
export interface ReachedTempo {
  mode: "citation" | "natural" | "seconds";
  asked_seconds: number | null;
  seconds: number | null;
}

/** Files in base64; null for a format that was not requested or cannot hold the clip. */
export interface Files {
  bvh: string | null;
  glb: string | null;
  vrma: string | null;
  pose: string | null;
}

/** Options of a splice. What is left out has the default of the command line. */
export interface Dials {
  cutter?: string | null;
  transition?: string | null;
  transition_time?: "auto" | "tempo" | "fixed" | number;
  sign_speed?: number;
  tempo?: "citation" | "natural" | number;
  fps?: number | null;
  body_sense?: boolean | null;
  free_hand?: "transition" | "natural";
  person?: number;
  seed?: number;
  system?: "lptransformer" | "lpt-plus" | null;
}

/** What to sign, ``glosses`` or ``text``, and how. */
export interface SentenceRequest {
  cutter?: string | null;
  transition?: string | null;
  transition_time?: "auto" | "tempo" | "fixed" | number;
  sign_speed?: number;
  tempo?: "citation" | "natural" | number;
  fps?: number | null;
  body_sense?: boolean | null;
  free_hand?: "transition" | "natural";
  person?: number;
  seed?: number;
  system?: "lptransformer" | "lpt-plus" | null;
  glosses?: string[] | null;
  text?: string | null;
  spell?: boolean;
  compounds?: boolean;
  drop_function_words?: boolean;
  language?: string;
  one_language?: boolean;
  pauses?: boolean;
  face_rules?: boolean;
  formats?: ("bvh" | "glb" | "vrma" | "pose")[];
  mesh?: boolean;
  whole_face?: boolean;
  avatar?: string | null;
}

/** The form field ``options`` of a splice of files. */
export interface SpliceRequest {
  cutter?: string | null;
  transition?: string | null;
  transition_time?: "auto" | "tempo" | "fixed" | number;
  sign_speed?: number;
  tempo?: "citation" | "natural" | number;
  fps?: number | null;
  body_sense?: boolean | null;
  free_hand?: "transition" | "natural";
  person?: number;
  seed?: number;
  system?: "lptransformer" | "lpt-plus" | null;
  formats?: ("bvh" | "glb" | "vrma" | "pose")[];
  mesh?: boolean;
  avatar?: string | null;
}

/** The report of a splice, version 1. */
export interface Report {
  version: number;
  fps: number;
  frames: number;
  cutter: string;
  transition: string;
  bundle: string | null;
  spans: Span[];
  seams: Seam[];
  warnings: string[];
  tempo: ReachedTempo;
  timing_ms: Record<string, number>;
}

/** A spliced sentence. */
export interface Spliced {
  name: string;
  report: Report;
  files: Files;
  units: SentenceToken[];
  spelled: string[];
}

/** An avatar that the service keeps until no request has named it for an hour, by default. */
export interface UploadedAvatar {
  avatar: string;
}

/** A word of the lexicon. */
export interface LexiconWord {
  gloss: string;
  kind: "sign" | "letter";
  synonyms: string[];
  seconds: number;
  signer: string;
  checked: boolean;
  language: string;
}

/** One page of the lexicon's words, in order. */
export interface WordList {
  words: LexiconWord[];
  total: number;
}

/** A cutter, transition, duration rule, or system that joins whole words. */
export interface MethodInfo {
  kind: "cutter" | "transition" | "duration" | "system";
  name: string;
  summary: string;
  learned: boolean;
  default: boolean;
}

/** The state of the service. */
export interface Health {
  status: "ok" | "starting";
  version: string;
  words: number;
  waiting: number;
  streams: number;
}

/** Why a request failed. */
export interface Failure {
  error: string;
  unknown: Record<string, string[]>;
}

/** The first message of a stream's client. */
export interface OpenMessage {
  cutter?: string | null;
  transition?: string | null;
  transition_time?: "auto" | "tempo" | "fixed" | number;
  sign_speed?: number;
  tempo?: "citation" | "natural" | number;
  fps?: number | null;
  body_sense?: boolean | null;
  free_hand?: "transition" | "natural";
  person?: number;
  seed?: number;
  system?: "lptransformer" | "lpt-plus" | null;
  type: "open";
  paced?: boolean;
  spell?: boolean;
  compounds?: boolean;
  drop_function_words?: boolean;
  language?: string;
  one_language?: boolean;
  pauses?: boolean;
  face_rules?: boolean;
  avatar?: string | null;
}

/** One more word, or a token to spell. */
export interface WordMessage {
  type: "word";
  gloss: string;
}

/** A line as it is typed, read as that of a sentence. */
export interface TextMessage {
  type: "text";
  text: string;
}

/** The last message of a stream's client: no more words follow. */
export interface EndMessage {
  type: "end";
}

/** The skeleton of the stream's frames; sent once, before them. */
export interface SkeletonMessage {
  type: "skeleton";
  fps: number;
  names: string[];
  parents: number[];
  nodes: number[] | null;
  offsets: [number, number, number][];
  metres: number;
  cutter: string;
  transition: string;
}

/** The span of the frames that follow. */
export interface SpanMessage {
  type: "span";
  span: Span;
}

/** The seam before the span that follows. */
export interface SeamMessage {
  type: "seam";
  seam: Seam;
}

/** The face in the frames that follow; none is sent where they have none. */
export interface FaceMessage {
  type: "face";
  first: number;
  channels: string[];
  weights: number[][];
}

/** How a word of the client's was read, before its frames; it has no glosses where it was left out. */
export interface UnitMessage {
  type: "unit";
  unit: SentenceToken;
}

/** A warning to show to the user. */
export interface WarningMessage {
  type: "warning";
  warning: string;
}

/** The last message of a stream: all frames have been sent, and the socket closes. */
export interface DoneMessage {
  type: "done";
  frames: number;
}

/** A message of the client was wrong. */
export interface ErrorMessage {
  type: "error";
  error: string;
  unknown: Record<string, string[]>;
}

export type ClientMessage = OpenMessage | WordMessage | TextMessage | EndMessage;

export type ServiceMessage = SkeletonMessage | UnitMessage | SpanMessage | SeamMessage | FaceMessage | WarningMessage | DoneMessage | ErrorMessage;
