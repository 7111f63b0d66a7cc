// Bundles the pages into dist/: for the rig's and for that of `trocar anatomy --edit` one script, one style sheet and one
// document each, nothing from elsewhere.
import { build } from "esbuild";
import { cp, mkdir, rm } from "node:fs/promises";
import { fileURLToPath } from "node:url";

const here = (path) => fileURLToPath(new URL(path, import.meta.url));

await rm(here("dist"), { recursive: true, force: true });
await mkdir(here("dist"), { recursive: true });
await build({
  entryPoints: { app: here("src/main.js"), style: here("src/style.css"), anatomy: here("src/anatomy/main.js") },
  outdir: here("dist"),
  bundle: true,
  format: "esm",
  target: "es2022",
  minify: true,
  legalComments: "linked",
  logLevel: "info",
});
await cp(here("src/index.html"), here("dist/index.html"));
for (const file of ["anatomy.html", "anatomy.css"]) await cp(here(`src/anatomy/${file}`), here(`dist/${file}`));
await cp(here("src/icon.svg"), here("dist/icon.svg"));
