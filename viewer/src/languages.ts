/** Every text of the page, in each of its languages. */

import { MEDIA_TYPES } from './wire.js';

const en = {
  skip: 'Skip to the controls',
  glosses: 'Glosses, in the order of signing',
  glossesHint: 'HELLO MY NAME fs-ANNA',
  suggestions: 'Words of the lexicon',
  meant: '{typed}: did you mean',
  sign: 'Sign',
  openFiles: 'Open files',
  openFilesHint: 'Clips ({suffixes}) to splice in order, or an avatar (.vrm)',
  stage: 'The signer',
  drop: 'Drop clips to splice, or a .vrm avatar',
  timeLine: 'Time line',
  frame: 'Frame',
  controls: 'Controls',
  play: 'Play',
  pause: 'Pause',
  back: 'One frame back',
  on: 'One frame forward',
  speed: 'Speed',
  loop: 'Loop',
  noLoop: 'nothing',
  everything: 'everything',
  camera: 'Camera',
  front: 'Front',
  side: 'Side',
  hands: 'Hands',
  mirror: 'Mirror',
  mirrorHint: 'As in a mirror',
  captions: 'Glosses',
  panel: 'Dials, seams and downloads',
  dials: 'Dials',
  transitionTime: 'Transition time',
  auto: 'automatic, word by word',
  signSpeed: 'Sign speed',
  tempo: 'Tempo',
  asRecorded: 'as recorded',
  natural: 'natural',
  freeHand: 'Idle hand',
  withTransition: 'falls between signs',
  person: 'Head and trunk move',
  cutter: 'Where to cut',
  transition: 'Transition',
  system: 'Whole system',
  compare: 'Compare with',
  nothing: 'nothing',
  standard: 'default',
  seams: 'Seams',
  seam: 'Seam',
  seconds: 's',
  peak: 'peak m/s',
  jump: 'jump m/s',
  downloads: 'Download',
  film: 'Film',
  report: 'Report',
  page: 'This page',
  pageHint: 'One file that opens from disk, without a network',
  keys: 'Keyboard shortcuts',
  note: 'No Deaf signer has judged this animation yet. Glosses are labels of signs, not a translation.',
  byRule: 'Faces blink and ask by rule alone.',
  loading: 'Making the animation …',
  shown: '{name}: {seconds} s, {frames} frames',
  fitted: 'hands fitted to the body of {avatar}',
  copied: '{avatar} turns its joints as signed: hands do not keep their contacts',
  drawing: 'The service draws the film; that takes some seconds …',
  filming: 'Making the film: {done} of {total} frames',
  noFilm: 'This browser cannot make films here: WebCodecs is missing; use https or localhost.',
  noFile: 'This clip has no {file} file.',
  needsService: 'To splice clips, run `signsplice serve`; a saved page can only open avatars (.vrm).',
  noAvatar: '{name} is not a VRM avatar that can be shown: {why}',
  notRead: '{name} cannot be opened; expected {suffixes} or .vrm',
  noVrma: 'This clip has no VRM animation, so no avatar can play it.',
  broken: 'This page cannot show animations here:',
  flat: 'This browser has no WebGL, so no figure moves here: pictures of it are shown where a service draws them, and a film at the button. Turn on graphics acceleration in its settings, or open the page in another browser.',
  and: '; ',
  spelled: 'spelled: {words}',
  leftOut: 'left out: {words}',
  typable: 'The lexicon has no {words}. Glosses are typed in Latin letters, such as {examples}; other words as fs- and letters, such as fs-ANNA.',
  lost: 'The service does not answer. Is it still running?',
  refused: 'The service at {address} does not answer, or does not allow this page: signsplice serve --allow-origin {page}',
  transitionTo: 'transition from {before} to {after}; loop it',
  goTo: 'go to {name}',
  frameValue: 'frame {frame} of {frames}, {caption}',
  keysOn: 'Use keyboard shortcuts',
  key_space: 'play or pause',
  key_arrows: 'one frame back or forward',
  key_shift: 'previous or next seam; loop it',
  key_l: 'stop looping',
  key_views: 'camera: front, side, hands',
  key_m: 'mirror',
  key_speed: 'slower, faster',
};

const zh: typeof en = {
  skip: '跳到控制栏',
  glosses: '按打手语的顺序输入词目',
  glossesHint: 'HELLO MY NAME fs-ANNA',
  suggestions: '词库中的词',
  meant: '{typed}：您是不是要找',
  sign: '打手语',
  openFiles: '打开文件',
  openFilesHint: '按顺序拼接的片段（{suffixes}），或虚拟形象（.vrm）',
  stage: '手语者',
  drop: '拖入要拼接的片段，或 .vrm 虚拟形象',
  timeLine: '时间线',
  frame: '帧',
  controls: '控制',
  play: '播放',
  pause: '暂停',
  back: '后退一帧',
  on: '前进一帧',
  speed: '速度',
  loop: '循环',
  noLoop: '不循环',
  everything: '全部',
  camera: '镜头',
  front: '正面',
  side: '侧面',
  hands: '手部',
  mirror: '镜像',
  mirrorHint: '像照镜子一样',
  captions: '词目字幕',
  panel: '调节、接缝与下载',
  dials: '调节',
  transitionTime: '过渡时间',
  auto: '自动，逐词确定',
  signSpeed: '手语速度',
  tempo: '节奏',
  asRecorded: '与录制相同',
  natural: '自然',
  freeHand: '空闲的手',
  withTransition: '在词间落下',
  person: '头与躯干的动作',
  cutter: '切点方法',
  transition: '过渡方法',
  system: '整体系统',
  compare: '并排显示',
  nothing: '无',
  standard: '默认',
  seams: '接缝',
  seam: '接缝',
  seconds: '秒',
  peak: '峰值 m/s',
  jump: '跳变 m/s',
  downloads: '下载',
  film: '视频',
  report: '报告',
  page: '本页',
  pageHint: '一个文件，可离线打开',
  keys: '快捷键',
  note: '尚无聋人手语者评判过此动画。词目只是手语的标签，不是翻译。',
  byRule: '面部只按规则眨眼、扬眉。',
  loading: '正在生成动画……',
  shown: '{name}：{seconds} 秒，{frames} 帧',
  fitted: '双手已按 {avatar} 的身体调整',
  copied: '{avatar} 只复制了关节的转动：双手不保持接触',
  drawing: '服务正在绘制视频，需要几秒钟……',
  filming: '正在生成视频：{done} / {total} 帧',
  noFilm: '此浏览器在这里无法生成视频（缺少 WebCodecs：请使用 https 或 localhost）。',
  noFile: '此片段没有 {file} 文件。',
  needsService: '拼接片段需要服务：`signsplice serve`。保存的页面只能显示虚拟形象（.vrm）。',
  noAvatar: '{name} 不是可显示的 VRM 虚拟形象：{why}',
  notRead: '无法读取 {name}；应为 {suffixes} 或 .vrm',
  noVrma: '此片段没有 VRM 动画，虚拟形象无法播放。',
  broken: '此页面无法在这里显示动画：',
  flat: '此浏览器没有 WebGL，无法显示动画；有服务时显示其绘制的图片，按“视频”按钮可看影片。请在设置中打开图形加速，或换一个浏览器打开本页。',
  and: '；',
  spelled: '拼写：{words}',
  leftOut: '省略：{words}',
  typable: '词库中没有“{words}”。词目用拉丁字母输入，例如 {examples}；其他词可用 fs- 加字母拼写，例如 fs-ANNA。',
  lost: '服务没有响应。它还在运行吗？',
  refused: '{address} 的服务没有响应，或不允许此页面访问：signsplice serve --allow-origin {page}',
  transitionTo: '从 {before} 到 {after} 的过渡；循环播放',
  goTo: '跳到 {name}',
  frameValue: '第 {frame} 帧，共 {frames} 帧，{caption}',
  keysOn: '启用快捷键',
  key_space: '播放或暂停',
  key_arrows: '后退或前进一帧',
  key_shift: '上一个或下一个接缝，并循环',
  key_l: '取消循环',
  key_views: '镜头：正面、侧面、手部',
  key_m: '镜像',
  key_speed: '减速、加速',
};

export type TextKey = keyof typeof en;
const languages = { en, zh };
export type Language = keyof typeof languages;

let current: Language = 'en';

export function language(): Language {
  return current;
}

/** The language to start with: the one chosen before, else the browser's. */
export function preferred(): Language {
  const kept = (() => {
    try {
      return localStorage.getItem('signsplice-language');
    } catch {
      return null; // pages from disk may have no storage
    }
  })();
  return kept === 'en' || kept === 'zh' ? kept : navigator.language.toLowerCase().startsWith('zh') ? 'zh' : 'en';
}

export function isLanguage(code: string): code is Language {
  return code in languages;
}

/** A text in the page's language, with values for its {names}; {suffixes} are those of the formats of clips. */
export function translate(key: TextKey, values: Record<string, string | number> = {}): string {
  return translateTo(current, key, values);
}

/** A text in a language. */
export function translateTo(language: Language, key: TextKey, values: Record<string, string | number> = {}): string {
  const suffixes = [...Object.keys(MEDIA_TYPES), 'sigml'].map((format) => `.${format}`);
  values = { suffixes: suffixes.join(language === 'zh' ? '、' : ', '), ...values };
  return languages[language][key].replace(/\{(\w+)\}/g, (_, name: string) => String(values[name] ?? ''));
}

/** Show the page in a language. */
export function setLanguage(chosen: Language): void {
  current = chosen;
  try {
    localStorage.setItem('signsplice-language', chosen);
  } catch {
    /* see preferred() */
  }
  document.documentElement.lang = chosen === 'zh' ? 'zh-CN' : 'en';
  for (const node of document.querySelectorAll<HTMLElement>('[data-text], [data-label], [data-title], [data-placeholder]')) {
    const { text, label, title, placeholder } = node.dataset as Record<string, TextKey | undefined>;
    if (text) node.textContent = translate(text);
    if (label) node.setAttribute('aria-label', translate(label));
    if (title) node.title = translate(title);
    if (placeholder) node.setAttribute('placeholder', translate(placeholder));
  }
}
