// Generated from the Python modules of the same names; do not edit.

export const t_pose = {
  T_POSE_BONES: {"leftShoulder": ["leftUpperArm", [1.0, 0.0, 0.0]], "leftUpperArm": ["leftLowerArm", [1.0, 0.0, 0.0]], "leftLowerArm": ["leftHand", [1.0, 0.0, 0.0]], "leftIndexProximal": ["leftIndexIntermediate", [1.0, 0.0, 0.0]], "leftIndexIntermediate": ["leftIndexDistal", [1.0, 0.0, 0.0]], "leftMiddleProximal": ["leftMiddleIntermediate", [1.0, 0.0, 0.0]], "leftMiddleIntermediate": ["leftMiddleDistal", [1.0, 0.0, 0.0]], "leftRingProximal": ["leftRingIntermediate", [1.0, 0.0, 0.0]], "leftRingIntermediate": ["leftRingDistal", [1.0, 0.0, 0.0]], "leftLittleProximal": ["leftLittleIntermediate", [1.0, 0.0, 0.0]], "leftLittleIntermediate": ["leftLittleDistal", [1.0, 0.0, 0.0]], "leftThumbMetacarpal": ["leftThumbProximal", [0.6666666666666666, -0.3333333333333333, 0.6666666666666666]], "leftThumbProximal": ["leftThumbDistal", [0.6666666666666666, -0.3333333333333333, 0.6666666666666666]], "leftUpperLeg": ["leftLowerLeg", [0.0, -1.0, 0.0]], "leftLowerLeg": ["leftFoot", [0.0, -1.0, 0.0]], "rightShoulder": ["rightUpperArm", [-1.0, 0.0, 0.0]], "rightUpperArm": ["rightLowerArm", [-1.0, 0.0, 0.0]], "rightLowerArm": ["rightHand", [-1.0, 0.0, 0.0]], "rightIndexProximal": ["rightIndexIntermediate", [-1.0, 0.0, 0.0]], "rightIndexIntermediate": ["rightIndexDistal", [-1.0, 0.0, 0.0]], "rightMiddleProximal": ["rightMiddleIntermediate", [-1.0, 0.0, 0.0]], "rightMiddleIntermediate": ["rightMiddleDistal", [-1.0, 0.0, 0.0]], "rightRingProximal": ["rightRingIntermediate", [-1.0, 0.0, 0.0]], "rightRingIntermediate": ["rightRingDistal", [-1.0, 0.0, 0.0]], "rightLittleProximal": ["rightLittleIntermediate", [-1.0, 0.0, 0.0]], "rightLittleIntermediate": ["rightLittleDistal", [-1.0, 0.0, 0.0]], "rightThumbMetacarpal": ["rightThumbProximal", [-0.6666666666666666, -0.3333333333333333, 0.6666666666666666]], "rightThumbProximal": ["rightThumbDistal", [-0.6666666666666666, -0.3333333333333333, 0.6666666666666666]], "rightUpperLeg": ["rightLowerLeg", [0.0, -1.0, 0.0]], "rightLowerLeg": ["rightFoot", [0.0, -1.0, 0.0]]},
  UPRIGHT: ["hips", "spine", "chest", "upperChest", "neck", "head", "jaw", "leftEye", "rightEye", "leftFoot", "rightFoot"],
  BENT_DEG: 20.0,
  STATURE_M: 1.7,
  UNITS: {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "foot": 0.3048},
  PERSON_M: [0.5, 2.8],
  ARMS: [["leftUpperArm", "leftLowerArm", "leftHand"], ["rightUpperArm", "rightLowerArm", "rightHand"]],
  LEGS: [["leftUpperLeg", "leftLowerLeg", "leftFoot"], ["rightUpperLeg", "rightLowerLeg", "rightFoot"]],
  ARM_FRACTION: 0.33199999999999996,
  LEG_FRACTION: 0.491,
  SHOULDER_FRACTION: 0.259,
} as const;

export const info = {
  ARM: ["Shoulder", "UpperArm", "LowerArm", "Hand"],
  FINGERS: ["Thumb", "Index", "Middle", "Ring", "Little"],
  SIDES: ["left", "right"],
  TRUNK: ["spine", "chest", "upperChest", "neck", "head"],
  ROLES: ["spine", "chest", "upperChest", "neck", "head", "leftShoulder", "leftUpperArm", "leftLowerArm", "leftHand", "leftThumbMetacarpal", "leftThumbProximal", "leftThumbDistal", "leftIndexProximal", "leftIndexIntermediate", "leftIndexDistal", "leftMiddleProximal", "leftMiddleIntermediate", "leftMiddleDistal", "leftRingProximal", "leftRingIntermediate", "leftRingDistal", "leftLittleProximal", "leftLittleIntermediate", "leftLittleDistal", "rightShoulder", "rightUpperArm", "rightLowerArm", "rightHand", "rightThumbMetacarpal", "rightThumbProximal", "rightThumbDistal", "rightIndexProximal", "rightIndexIntermediate", "rightIndexDistal", "rightMiddleProximal", "rightMiddleIntermediate", "rightMiddleDistal", "rightRingProximal", "rightRingIntermediate", "rightRingDistal", "rightLittleProximal", "rightLittleIntermediate", "rightLittleDistal"],
  N_SIDE: 19,
  TIPS: ["leftHand", "leftThumbDistal", "leftIndexDistal", "leftMiddleDistal", "leftRingDistal", "leftLittleDistal", "rightHand", "rightThumbDistal", "rightIndexDistal", "rightMiddleDistal", "rightRingDistal", "rightLittleDistal"],
  MIRROR: [0, 1, 2, 3, 4, 24, 25, 26, 27, 28, 29, 30, 31, 32, 33, 34, 35, 36, 37, 38, 39, 40, 41, 42, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23],
  RAISED_FRACTION: 0.4,
  NO_REST_LIFT: 0.1,
  FEATURE_FPS: 30.0,
} as const;

export const capsules = {
  SIDES: ["left", "right"],
  ARM: ["sleeve", "cuff"],
  LIMBS: [["UpperArm", "LowerArm", 0.031, 0.024, "sleeve"], ["LowerArm", "Hand", 0.024, 0.0165, "cuff"], ["UpperLeg", "LowerLeg", 0.052, 0.036, "leg"], ["LowerLeg", "Foot", 0.036, 0.024, "leg"], ["Foot", "Toes", 0.024, 0.02, "shoe"]],
  COLUMNS: [[0.058, 0.053], [0.0, 0.06], [-0.058, 0.053]],
  BELOW_SHOULDERS: 0.045,
  WAIST: [0.94, 0.92],
  HEM: 0.035,
  SEAT: [1.08, 0.057],
  HIPS: [0.95, 0.057],
  NECK: [0.02, 0.03, 0.029],
  BACK: [0.02, 0.044, 0.05],
  COLLAR: [0.55, 0.45, 0.004, 0.034, 0.033],
  SHOULDER: [[0.2, 0.93], [0.035, 0.0325]],
  HEAD: [["face", [0.0, 0.03, 0.018], [0.0, 0.07, 0.016], 0.04, 0.051], ["face", [0.0, 0.006, 0.032], [0.0, 0.03, 0.026], 0.024, 0.04], ["nose", [0.0, 0.052, 0.068], [0.0, 0.038, 0.073], 0.0055, 0.0085], ["hair", [0.0, 0.08, -0.004], [0.0, 0.048, -0.016], 0.054, 0.051], ["eye", [0.0195, 0.061, 0.0585], [0.0195, 0.061, 0.0585], 0.0065, 0.0065], ["eye", [-0.0195, 0.061, 0.0585], [-0.0195, 0.061, 0.0585], 0.0065, 0.0065], ["mouth", [0.0125, 0.0178, 0.057], [0.0, 0.017, 0.06], 0.0036, 0.0046], ["mouth", [-0.0125, 0.0178, 0.057], [0.0, 0.017, 0.06], 0.0036, 0.0046]],
} as const;

export const hand_capsules = {
  FINGERS: ["Thumb", "Index", "Middle", "Ring", "Little"],
  SEGMENTS: ["Metacarpal", "Proximal", "Intermediate", "Distal"],
  THICKNESS: {"Thumb": 0.0068, "Index": 0.0058, "Middle": 0.0059, "Ring": 0.0056, "Little": 0.0049},
  PALM: [0.12, 0.0095, 1.22, 1.35],
  MITTEN: [0.08, 0.02, 0.018],
  TAPER: [1.12, 0.09],
  TIP: [0.2, 2.0, 0.8],
} as const;

export const gltf_mesh = {
  N_JOINTS: 4,
  TRIANGLES: 4,
  VERTEX_BYTES: 400,
  INDEX_BYTES: 64,
  PART_BYTES: 4000,
  JOINT_BYTES: 400,
  LOOSE: ["acc", "accessories", "accessory", "ahoge", "backpack", "bag", "bangs", "bow", "braid", "cap", "cape", "cloak", "coat", "earring", "earrings", "eyelash", "eyelashes", "glasses", "goggles", "hair", "hat", "helmet", "hood", "horn", "lash", "lashes", "mask", "necklace", "necktie", "outline", "ponytail", "ribbon", "scarf", "skirt", "tail", "twintail", "weapon", "wig", "wing"],
  CLOTH: ["blouse", "boots", "bottom", "bottoms", "cloth", "clothes", "clothing", "cuff", "cuffs", "dress", "glove", "gloves", "hoodie", "jacket", "jeans", "kimono", "onepiece", "outfit", "pants", "robe", "shirt", "shoe", "shoes", "shorts", "sleeve", "sleeves", "socks", "suit", "sweater", "top", "tops", "trousers", "tshirt", "uniform", "vest", "yukata"],
  SOFT: ["belly", "boob", "boobs", "breast", "breasts", "bust", "butt", "chichi", "helper", "hip", "hips", "mune", "muscle", "oppai", "roll", "twist"],
  LOOSE_SIGNS: ["髪", "スカート", "リボン", "帽", "眼鏡"],
  SOFT_SIGNS: ["胸", "乳"],
} as const;

export const skin_points = {
  MIN_POINTS: 6,
  BARE: 4,
  MOST_ROWS: 8,
  MOST_SAMPLES: 300000,
  OWN: 0.49,
  WIDER: [1.0, 2.0, 4.0],
} as const;

export const skin = {
  HEM: 0.035,
  MIN_POINTS: 6,
  FINGERS: ["Thumb", "Index", "Middle", "Ring", "Little"],
  SIDES: ["left", "right"],
  TRUNK: ["hips", "spine", "chest", "upperChest", "leftShoulder", "rightShoulder"],
  HEAD: ["head", "jaw", "leftEye", "rightEye"],
  BODY: ["hips", "spine", "chest", "upperChest", "leftShoulder", "rightShoulder", "head", "jaw", "leftEye", "rightEye", "neck"],
  ARM: ["sleeve", "cuff"],
  LIMBS: {"arms": ["sleeve", "cuff"], "legs": ["leg"], "neck": ["neck"]},
  BINS: 6,
  STEP: 0.004,
  BELOW_HEM: 0.01,
  SPAN: 0.4,
  TAPERS: [0.7, 1.2],
  ALONG: [-0.1, 1.1],
  SHORTEST: 0.3,
  SLICES: [[0.2, 0.6], 0.45, 0.6],
  WIDE: 1.7,
  THICK: 3.0,
  BETWEEN: [0.05, 0.95],
} as const;

export const skin_trunk = {
  MIN_POINTS: 6,
  LEVEL: 0.015,
  NEAR: 0.01,
  HEIGHTS: 7,
  ACROSS: 0.55,
  WIDEST: 0.98,
  OUT: [0.3, 0.75],
  LEAST_HEIGHTS: 3,
  LOWER_CHEST: [0.55, 0.25],
} as const;

export const skin_head = {
  MIN_POINTS: 6,
  CHIN: -0.0092,
  TOP: 0.134,
  WIDTH: 0.045,
  BALLS: {"face": 0, "chin": 1, "nose": 2, "skull": 3},
  CELL: 0.006,
  LEAST: 10,
  FRONT: 0.4,
  JAW: [0.6, 0.4],
  WIDEST: 0.98,
  TALL: [0.8, 1.3],
  PROFILE: [["chin", 0, 0.012], ["chin", 1, 0.012], ["face", 0, 0.012], ["face", 1, 0.02]],
  BELOW: 0.25,
  BESIDE: 0.6,
  OPEN: 0.25,
  NOSE: [0.15, 0.2, 0.6, 0.5],
  N_BALLS: 5,
  GRAZING: 0.3,
} as const;

export const relief = {
  AROUND_M: 0.015,
  SHARP_M: 0.005,
  FARTHEST_M: 0.05,
  NEAREST: 64,
  FACING: 0.3,
  HIDDEN_M: 0.008,
  SHOWN_M: 0.003,
  CHUNK: 4096,
} as const;

export const skin_surface = {
  BLEND_M: 0.05,
  MOST_WEIGHTS: 20000000,
  CHUNK: 4096,
  COVER: [0.0015, 0.015],
  AROUND: 24,
  FACING: 0.3,
  REACH_M: 0.03,
  THICK_M: [0.03, 0.015],
} as const;

export const fit = {
  SIDES: ["left", "right"],
  NEAR_M: 0.04,
  FREE_M: 0.06,
  FAR_M: 0.25,
  SPACE_WEIGHT: 0.15,
  SMOOTHNESS: 100.0,
  FPS: 30.0,
  CONTACT_WEIGHT: 60.0,
  CONTACT_FADE_M: 0.006,
  LEAST_WEIGHT: 0.001,
  TOUCH_M: 0.012,
  CLEAR_M: 0.01,
  PRESS_M: 0.002,
  MARGIN_M: 0.035,
  STEPS: 4,
  STEPS_AGAIN: 2,
  DAMPING: 10.0,
  REACH: 0.985,
  REACH_WEIGHT: 60.0,
  SIGNS: 0.5,
  ARM_SHARES: {"sleeve": [0.0, 0.5], "cuff": [0.5, 1.0]},
  ANCHORS: [["ThumbDistal", 1.0], ["IndexDistal", 1.0], ["MiddleDistal", 1.0], ["RingDistal", 1.0], ["LittleDistal", 1.0], ["IndexPalm", 1.0], ["LittlePalm", 1.0], ["MiddlePalm", 0.6], ["Mitten", 0.3], ["Mitten", 1.0]],
} as const;

export const skin_contacts = {
  ARM: ["sleeve", "cuff"],
  CLEAR_M: 0.01,
  CONTACT_FADE_M: 0.006,
  CONTACT_WEIGHT: 60.0,
  PRESS_M: 0.002,
  TOUCH_M: 0.012,
  THICK_M: [0.03, 0.015],
  NEAR_M: 0.045,
  LOW_M: 0.025,
  MOST_ACROSS: 1.5,
  SHARP_M: 0.001,
  ROUNDS: 3,
  HOLD: 1.0,
  TOGETHER: 30.0,
  TOGETHER_M: 0.01,
  TIE: [[1.0, 0.0, 0.0, -1.0, -0.0, -0.0], [0.0, 1.0, 0.0, -0.0, -1.0, -0.0], [0.0, 0.0, 1.0, -0.0, -0.0, -1.0], [-1.0, -0.0, -0.0, 1.0, 0.0, 0.0], [-0.0, -1.0, -0.0, 0.0, 1.0, 0.0], [-0.0, -0.0, -1.0, 0.0, 0.0, 1.0]],
  BODY: 0,
  HANDS: 1,
  KINDS: [[0, 0], [1, 0], [0, 1]],
} as const;

export const swivel = {
  GRID: [-1.0471975511965976, -0.7853981633974483, -0.5235987755982988, -0.2617993877991494, 0.0, 0.2617993877991494, 0.5235987755982988, 0.7853981633974483, 1.0471975511965976],
  TURN: 0.5235987755982988,
  TURN_WEIGHT: 0.15,
  CHANGE_WEIGHT: 0.5,
  WIDTH_S: 0.06,
  LEAST_WIDTH: 0.5,
  DEEP: 0.0001,
  AROUND_S: 0.3,
} as const;

export const arm_ik = {
  REACH: 0.999,
  STRAIGHT: 0.05,
  HINGES: [[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]],
  TINY: 1e-09,
} as const;

export const thumb_contacts = {
  FINGERS: ["Thumb", "Index", "Middle", "Ring", "Little"],
  SIDES: ["left", "right"],
  ALIKE: 0.03,
  MOST_RADIANS: 0.2617993877991494,
  NEAR_M: 0.012,
  FADE_M: 0.004,
  DAMPING: 0.0002,
  TOGETHER: 0.002,
  APART_RADIANS: 0.2617993877991494,
  STEPS: 3,
  WIDTH_S: 0.05,
  THUMB: ["ThumbMetacarpal", "ThumbProximal", "ThumbDistal"],
  SEGMENTS: ["Palm", "Proximal", "Intermediate", "Distal"],
  FLEXION: [0.0, 0.0, 1.0],
} as const;

export const retarget = {
  PART_M: 0.012,
  SIGNS: 0.5,
  SIDES: ["left", "right"],
  ALIKE: 0.005,
  NAMED: 6,
  SHORT: 0.1,
  BEYOND_M: 0.02,
  FADE_S: 0.15,
  HANGING: 0.95,
  RAISED: 0.85,
  FOREARM_MARGIN_M: 0.03,
  WINDOW: 1500,
  OVERLAP: 90,
} as const;
