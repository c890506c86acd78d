// Makes built/: three.js once, with the names that the two scripts use of it, and the scripts, which find it as the global `THREE`.
import { readFileSync } from 'node:fs';
import { build } from 'esbuild';
import * as three from 'three';

const common = { bundle: true, minify: true, format: 'iife', target: 'es2022', legalComments: 'inline' };
const addons = ['controls/OrbitControls', 'loaders/GLTFLoader'];
const shared = {
  name: 'three as a global',
  setup({ onResolve, onLoad }) {
    const filter = new RegExp(`^three($|/examples/jsm/(${addons.join('|')})\\.js$)`);
    onResolve({ filter }, () => ({ path: 'three', namespace: 'global' }));
    onLoad({ filter: /./, namespace: 'global' }, () => ({ contents: 'module.exports = THREE;' }));
  },
};
const scripts = ['report', 'tiles'];
await build({ ...common, entryPoints: scripts.map((name) => `${name}.js`), outdir: 'built', plugins: [shared] });
const code = scripts.map((name) => readFileSync(`built/${name}.js`, 'utf8')).join();
const names = Object.keys(three).filter((name) => new RegExp(`\\.${name}\\b`).test(code));
const contents = `export { ${names.join(', ')} } from 'three';` +
  addons.map((path) => `export { ${path.split('/')[1]} } from 'three/examples/jsm/${path}.js';`).join('');
await build({ ...common, stdin: { contents, resolveDir: '.' }, globalName: 'THREE', outfile: 'built/three.js' });
