import assert from "node:assert/strict";
import { test } from "node:test";
import { browser, inBrowser } from "../browser.mjs";

// Presses the button of the example and waits for a line.
const PAGE = `<!doctype html><iframe src="/example/index.html"></iframe><script type="module">
const frame = document.querySelector("iframe");
await new Promise((resolve) => (frame.onload = resolve));
const find = (id) => frame.contentDocument.getElementById(id);
let ticks = 0;
setInterval(() => ticks++, 10);
find("ratio").value = "0.05";
find("go").click();
while (!find("said").textContent) await new Promise((resolve) => setTimeout(resolve, 20));
await fetch("/done", { method: "POST", body: JSON.stringify({ said: find("said").textContent, ticks }) });
</script>`;

const program = browser();
const skip = program ? false : "no browser on this machine; CHROMIUM=... names one";
test("the example's worker simplifies a million triangles while the page stays awake", { skip }, async () => {
    const given = { "/test.html": PAGE };
    const posted = await inBrowser(program, { folder: new URL("..", import.meta.url).pathname, given, page: "/test.html" });
    const { said, ticks } = JSON.parse(posted.get("/done"));
    const [, before, after] = said.match(/^(\d+) triangles to (\d+) in [\d.]+ s\n$/) ?? assert.fail(said);
    assert.ok(before > 990_000 && after > 0.04 * before && after <= 0.05 * before, said);
    assert.ok(ticks > 5, `${ticks} ticks`);
});
