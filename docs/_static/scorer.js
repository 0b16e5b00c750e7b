// Ranks what the site's search finds: titles and headings with all words first, tutorials before names and commands.
var Scorer = {
  score: ([page, title, , , score]) => {
    const words = (new URLSearchParams(location.search).get("q") || "").toLowerCase().split(/\s+/);
    const titled = words.every((word) => title.toLowerCase().includes(word));
    const place = page.startsWith("tutorials/") ? 8 : page.startsWith("generated/") ? 0 : 4;
    return score + place + 16 * titled;
  },
  // The rest is as in Sphinx.
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
