import { defineConfig } from "vite";

export default defineConfig({
  base: "./",
  build: { target: "es2022", outDir: "dist", emptyOutDir: true, chunkSizeWarningLimit: 1500 },
  // `npm run dev` serves the page with reloading; the graph is that of `fuyu launch --cockpit`.
  server: { proxy: { "/ws": { target: "ws://127.0.0.1:8765", ws: true } } },
});
