// Words with a typing error: what may have been meant is offered beside the sentence, and signed when chosen.
// Also what else newcomers meet: words that are spelled, Chinese words, errors, an avatar that is no VRM, no WebGL.
// `node meant.mjs ADDRESS FIGURE.glb` prints what was seen as JSON.

import { readFileSync } from 'node:fs';
import { join } from 'node:path';
import { launch, shown, watched } from './browser.mjs';

const [address, figure] = process.argv.slice(2);
const browser = await launch();
const { page, faults } = await watched(browser, { viewport: { width: 390, height: 844 } });
const texts = (query) => page.locator(query).allTextContents();
const result = {};

await page.goto(`${address}?s=HELLO+frend%2C+i+love+you`);
await shown(page, 1);
result.spelled = await texts('#spans .sign button');
result.offered = await texts('#meant > *');
result.overflow = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
result.warnings = await texts('#warnings li');
result.status = await page.locator('#status').textContent();
await page.locator('#meant button').first().click();
await shown(page, 2);
result.line = await page.inputValue('#glosses');
result.signs = await texts('#spans .sign button');
result.isHidden = await page.locator('#meant').isHidden();

// A line with nothing that can be signed or spelled: the same beside the error.
await page.fill('#glosses', 'frięnδd');
await page.keyboard.press('Enter');
await page.waitForSelector('#alert:not([hidden])');
await page.waitForSelector('#meant:not([hidden])');
result.besideError = await texts('#meant > *');
// An error keeps what was typed.
const drop = (name, content) =>
  page.evaluate(([name, base64]) => {
    const transfer = new DataTransfer();
    transfer.items.add(new File([Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0))], name));
    document.body.dispatchEvent(new DragEvent('drop', { bubbles: true, cancelable: true, dataTransfer: transfer }));
  }, [name, content.toString('base64')]);
await page.fill('#glosses', 'HELLO MY');
await drop('broken.bvh', Buffer.from('HIERARCHY'));
await page.waitForFunction(() => document.querySelector('#alert').textContent.includes('broken.bvh'));
result.keptLine = await page.inputValue('#glosses');

// A .glb that does not move is an avatar.
await drop('figure.glb', readFileSync(figure));
await shown(page, 3);
result.avatar = await page.locator('#status').textContent();

// Signs that are written, pasted: SiGML, HamNoSys, and what is neither stays text.
const paste = (text) =>
  page.evaluate((text) => {
    const clipboardData = new DataTransfer();
    clipboardData.setData('text/plain', text);
    return document.querySelector('#glosses').dispatchEvent(new ClipboardEvent('paste', { bubbles: true, cancelable: true, clipboardData }));
  }, text);
result.pasted = [await paste('HELLO MY'), await paste(readFileSync(join(import.meta.dirname, '../../tests/synth/written_signs.sigml'), 'utf8'))];
await shown(page, 4);
result.written = await texts('#spans .sign button');
await paste('\ue000\ue020\ue038\ue049');
await shown(page, 5);
result.hamnosys = await texts('#spans .sign button');
await paste('\uf123');
await page.waitForSelector('#alert:not([hidden])');
result.unwritten = await page.locator('#alert').textContent();

// Words in Chinese, on the page in Chinese.
const { page: chinese } = await watched(browser, { locale: 'zh-CN', viewport: { width: 390, height: 844 }, reducedMotion: 'reduce' });
await chinese.goto(address);
await shown(chinese, 1);
await chinese.fill('#glosses', '你好 朋友');
await chinese.keyboard.press('Enter');
await chinese.waitForSelector('#alert:not([hidden])');
result.chinese = { alert: await chinese.locator('#alert').textContent(), line: await chinese.inputValue('#glosses') };

// A browser without WebGL.
const { page: flat } = await watched(browser, { viewport: { width: 390, height: 844 } });
await flat.addInitScript(() => (HTMLCanvasElement.prototype.getContext = () => null));
await flat.goto(`${address}?s=HELLO`);
await flat.waitForFunction(() => document.querySelector('sign-player').shadowRoot.querySelector('img')?.naturalWidth > 0);
result.flat = {
  note: await flat.locator('sign-player [role=alert]').textContent(),
  alt: await flat.locator('sign-player img').getAttribute('alt'),
  controls: await flat.locator('#controls').isVisible(),
  downloads: await flat.locator('[data-file=bvh]').isEnabled(),
};

result.faults = faults.filter((line) => !/ 4\d\d /.test(line));
if (process.env.SHOT) await page.screenshot({ path: process.env.SHOT });
console.log(JSON.stringify(result));
await browser.close();
