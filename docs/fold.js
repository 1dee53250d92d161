// Folds the parameters of long signatures, so that a page does not begin with a screen of them.
"use strict";
document.addEventListener("DOMContentLoaded", () => {
  for (const signature of document.querySelectorAll("dt.sig")) {
    const list = signature.querySelector(":scope > dl"), count = signature.querySelectorAll(".sig-param").length;
    if (!list || count <= 8) continue;
    const folded = document.createElement("details"), summary = document.createElement("summary");
    summary.textContent = `${count} parameters`;
    list.replaceWith(folded);
    folded.append(summary, list);
  }
});
