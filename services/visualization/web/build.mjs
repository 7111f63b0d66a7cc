// Bundles the pages into dist/: for the rig's and for that of `trocar anatomy --edit` one script, one style sheet and one
// document each, nothing from elsewhere.
import { build } from "esbuild";
import { cp, mkdir, rm } from "node:fs/promises";
import { fileURLToPath } from "node:url";

const here = (path) => fileURLToPath(new URL(path, import.meta.url));

await rm(here("dist"), { recursive: true, force: true });
await mkdir(here("dist"), { recursive: true });
await build({
  entryPoints: [
    { in: here("src/main.js"), out: "app" }, { in: here("src/style.css"), out: "style" },
    { in: here("src/anatomy/main.js"), out: "anatomy" }, { in: here("src/anatomy/anatomy.css"), out: "anatomy" },
  ],
  outdir: here("dist"),
  bundle: true,
  format: "esm",
  target: "es2022",
  minify: true,
  legalComments: "linked",
  logLevel: "info",
});
await cp(here("src/index.html"), here("dist/index.html"));
await cp(here("src/anatomy/anatomy.html"), here("dist/anatomy.html"));
await cp(here("src/icon.svg"), here("dist/icon.svg"));
