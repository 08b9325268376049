"use strict";
async function look() {
  const main = document.querySelector("main");
  if (!main.querySelector("[data-running]")) return;
  try {
    const page = new DOMParser().parseFromString(await (await fetch(location.href)).text(), "text/html");
    const now = page.querySelector("main");
    if (now.innerHTML !== main.innerHTML) main.replaceChildren(...now.childNodes);
    setTimeout(look, 1000);
  } catch { document.getElementById("lost").hidden = false; }
}
setTimeout(look, 1000);
