// How the search ranks what it finds: pages before names, and a class or a function before its attributes.
"use strict";
// `var`, because searchtools.js, which is loaded before, has a `var` of this name; `const` would be an error there.
var Scorer = {
  objNameMatch: 12,
  objPartialMatch: 2,
  objPrio: { 0: 4, 1: -4, 2: -10 },
  objPrioDefault: -10,
  title: 30,
  partialTitle: 14,
  term: 8,
  partialTerm: 3,
};
