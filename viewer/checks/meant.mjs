// Words with a typing error: what may have been meant is offered beside the sentence, and signed when chosen.
// `node meant.mjs ADDRESS` prints what was seen as JSON.

import { launch, shown, watched } from './browser.mjs';

const [address] = process.argv.slice(2);
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
await page.locator('#meant button').first().click();
await shown(page, 2);
result.line = await page.inputValue('#glosses');
result.signs = await texts('#spans .sign button');
result.isHidden = await page.locator('#meant').isHidden();

// A word that cannot be spelled either: the same beside the error.
await page.fill('#glosses', 'HELLO fri3.5nd');
await page.keyboard.press('Enter');
await page.waitForSelector('#alert:not([hidden])');
await page.waitForSelector('#meant:not([hidden])');
result.besideError = await texts('#meant > *');
result.faults = faults.filter((line) => !line.includes('422'));
if (process.env.SHOT) await page.screenshot({ path: process.env.SHOT });
console.log(JSON.stringify(result));
await browser.close();
