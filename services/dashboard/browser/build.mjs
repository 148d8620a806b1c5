// Writes the browser's libraries into ../static: each as one module without what the pages do not use, and their licences.

import { copyFile, readFile, writeFile } from "node:fs/promises";
import { build } from "esbuild";

const STATIC = new URL("../static/", import.meta.url);
const LIBRARIES = { three: "three", uplot: "uplot" };

const packed = (name) => new URL(`node_modules/${name}/`, import.meta.url);
const licences = [];
for (const [module, name] of Object.entries(LIBRARIES)) {
  const { version, license, homepage, repository } = JSON.parse(await readFile(new URL("package.json", packed(name))));
  const from = homepage ?? repository.url;
  await build({
    entryPoints: [new URL(`${module}.js`, import.meta.url).pathname],
    outfile: new URL(`${module}.js`, STATIC).pathname,
    bundle: true,
    minify: true,
    format: "esm",
    target: "es2022",
    legalComments: "none",
    banner: { js: `/* ${name} ${version}, ${license}, ${from}; its licence is in licences.txt beside this file. Built by browser/build.mjs. */` },
  });
  licences.push(`${name} ${version} (${from})\n\n${(await readFile(new URL("LICENSE", packed(name)), "utf8")).trim()}\n`);
}
await copyFile(new URL("dist/uPlot.min.css", packed("uplot")), new URL("uplot.css", STATIC));
await writeFile(new URL("licences.txt", STATIC), licences.join("\n----\n\n"));
