// Runs a page in a browser without a window, for tests and for compare.mjs --browser.
import { spawn, spawnSync } from "node:child_process";
import { once } from "node:events";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { createServer } from "node:http";
import { tmpdir } from "node:os";
import { extname, join, normalize } from "node:path";

const TYPES = { ".html": "text/html", ".mjs": "text/javascript", ".js": "text/javascript", ".wasm": "application/wasm" };
const NAMES = ["chromium", "chromium-browser", "google-chrome", "chrome"];

/// The browser of this machine: the one that CHROMIUM names, or one of the usual names; undefined if there is none.
export function browser() {
    const names = process.env.CHROMIUM ? [process.env.CHROMIUM] : NAMES;
    return names.find((name) => spawnSync(name, ["--version"]).status === 0);
}

/// Offers the files of a folder and those `given` (by path), opens `page`, and gives the bodies that it posts, by path, once it posts to
/// /done.
export async function inBrowser(program, { folder, given = {}, page, seconds = 120 }) {
    const posted = new Map();
    let done;
    const isDone = new Promise((resolve) => (done = resolve));
    const server = createServer(async (request, response) => {
        const path = normalize(new URL(request.url, "http://localhost").pathname);
        if (request.method === "POST") {
            const parts = [];
            for await (const part of request) parts.push(part);
            posted.set(path, Buffer.concat(parts));
            response.end();
            if (path === "/done") done();
            return;
        }
        try {
            const body = given[path] ?? readFileSync(join(folder, path));
            response.writeHead(200, { "content-type": TYPES[extname(path)] ?? "application/octet-stream" }).end(body);
        } catch {
            response.writeHead(404).end();
        }
    });
    server.listen(0, "127.0.0.1");
    await once(server, "listening");
    const profile = mkdtempSync(join(tmpdir(), "stonecut-browser-"));
    const address = `http://127.0.0.1:${server.address().port}${page}`;
    const words = ["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", `--user-data-dir=${profile}`, address];
    const chrome = spawn(program, words, { stdio: "ignore" });
    const gone = once(chrome, "exit");
    let timer;
    const tooLate = new Promise((_, reject) => {
        timer = setTimeout(() => reject(new Error(`the page was not done in ${seconds} s`)), 1000 * seconds);
    });
    try {
        const early = gone.then(([code]) => Promise.reject(new Error(`${program} ended with ${code} before the page was done`)));
        early.catch(() => {});
        await Promise.race([isDone, early, tooLate]);
        return posted;
    } finally {
        clearTimeout(timer);
        chrome.kill();
        await gone.catch(() => {});
        server.closeAllConnections();
        server.close();
        rmSync(profile, { recursive: true, force: true, maxRetries: 9 });
    }
}
