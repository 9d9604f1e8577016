// Asks the search worker of the built site, as its pages do: node site_search.js SITE QUERY...
const fs = require("fs"), path = require("path");
const [site, ...queries] = process.argv.slice(2);
const folder = path.join(site, "assets", "javascripts", "workers");
const name = fs.readdirSync(folder).find((file) => /^search\..*\.js$/.test(file));
const waiting = [];
let answer;
globalThis.self = globalThis;
globalThis.addEventListener = (kind, listener) => { answer = listener; };
globalThis.postMessage = (message) => waiting.shift()(message);
(0, eval)(fs.readFileSync(path.join(folder, name), "utf8"));
const ask = (type, data) => new Promise((done) => { waiting.push(done); answer({ data: { type, data } }); });

(async () => {
  const index = JSON.parse(fs.readFileSync(path.join(site, "search", "search_index.json"), "utf8"));
  await ask(0, { ...index, options: { suggest: false } });
  const found = [];
  for (const query of queries) {
    const { data } = await ask(2, query);
    found.push(data.items.map((sections) => sections.map((section) => section.location)));
  }
  console.log(JSON.stringify(found));
})();
