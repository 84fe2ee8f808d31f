// Generated from the service's wire.py; do not edit.

export type Format = "bvh" | "glb" | "vrma";

/** What a caller may turn; what is left out is the default of the command line. */
export interface Dials {
  cutter?: string | null;
  transition?: string | null;
  transition_time?: "auto" | "tempo" | "fixed" | "travel" | "speed" | number;
  sign_speed?: number;
  fps?: number | null;
  body_sense?: boolean | null;
}

/** A line of glosses to sign. spell: letters sign what is no word. formats: of the files that are wanted. */
export interface SentenceRequest {
  cutter?: string | null;
  transition?: string | null;
  transition_time?: "auto" | "tempo" | "fixed" | "travel" | "speed" | number;
  sign_speed?: number;
  fps?: number | null;
  body_sense?: boolean | null;
  glosses: string[];
  spell?: boolean;
  formats?: ("bvh" | "glb" | "vrma")[];
}

/** What is told beside the files of a splice, in its field ``options``. */
export interface SpliceRequest {
  cutter?: string | null;
  transition?: string | null;
  transition_time?: "auto" | "tempo" | "fixed" | "travel" | "speed" | number;
  sign_speed?: number;
  fps?: number | null;
  body_sense?: boolean | null;
  formats?: ("bvh" | "glb" | "vrma")[];
}

/** Where a stretch of the output comes from; frame ranges are half-open. */
export interface Span {
  kind: "sign" | "transition";
  clip: number | null;
  name: string | null;
  source: [number, number] | null;
  output: [number, number];
}

/** How two signs are joined, and how well; null where a score cannot be told. */
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
  timing_ms: Record<string, number>;
}

/** A token of a sentence, and the words or letters that sign it. */
export interface Unit {
  token: string;
  glosses: string[];
  spelled: boolean;
  warning: string;
}

/** Files in base64, those that were asked for and could be made. */
export interface Files {
  bvh: string | null;
  glb: string | null;
  vrma: string | null;
}

/** A spliced sentence: its name, its report and its files; units: how its glosses were read, none for files. */
export interface Spliced {
  name: string;
  report: Report;
  files: Files;
  units: Unit[];
}

/** A word of the lexicon. checked: a signer has said that the clip shows this sign. */
export interface Word {
  gloss: string;
  kind: "sign" | "letter";
  synonyms: string[];
  seconds: number;
  signer: string;
  checked: boolean;
}

/** Words of the lexicon in order, from the one that was asked for on; total: how many fit the search. */
export interface WordList {
  words: Word[];
  total: number;
}

/** A cutter, transition or duration by name. */
export interface Part {
  kind: "cutter" | "transition" | "duration";
  name: string;
  summary: string;
  learned: boolean;
  default: boolean;
}

/** That the service is there. waiting: requests that wait for a worker; streams: those that are open. */
export interface Health {
  status: "ok";
  version: string;
  words: number;
  waiting: number;
  streams: number;
}

/** What went wrong, in one line. unknown: every gloss that the lexicon has not, and the nearest ones that it has. */
export interface Failure {
  error: string;
  unknown: Record<string, string[]>;
}

/** First message of a stream's client. paced: frames come when they are due, else as fast as they are made. */
export interface Open {
  cutter?: string | null;
  transition?: string | null;
  transition_time?: "auto" | "tempo" | "fixed" | "travel" | "speed" | number;
  sign_speed?: number;
  fps?: number | null;
  body_sense?: boolean | null;
  type: "open";
  paced?: boolean;
  spell?: boolean;
}

/** One more word, or a token to spell. */
export interface Say {
  type: "word";
  gloss: string;
}

/** There are no more words. */
export interface End {
  type: "end";
}

/** What frames are of; comes before the first of them. offsets: places of joints from their parents', own unit; metres: how long that unit is. parents: joints' numbers, -1 for the root. */
export interface Skeleton {
  type: "skeleton";
  fps: number;
  names: string[];
  parents: number[];
  offsets: [number, number, number][];
  metres: number;
  cutter: string;
  transition: string;
}

/** Frames of this span are next. */
export interface SpanBegins {
  type: "span";
  span: Span;
}

/** The seam by which the span that follows is entered. */
export interface SeamJoined {
  type: "seam";
  seam: Seam;
}

/** Something that a user should know. */
export interface Warned {
  type: "warning";
  warning: string;
}

/** All frames have come; the socket closes. */
export interface Done {
  type: "done";
  frames: number;
}

/** A message was wrong. A word that is not known is left out, and the stream goes on; else the socket closes. */
export interface Failed {
  type: "error";
  error: string;
  unknown: Record<string, string[]>;
}

export type FromClient = Open | Say | End;

export type FromService = Skeleton | SpanBegins | SeamJoined | Warned | Done | Failed;
