// What viser's page cannot do by itself. It stands in the head of the page that companion serves, and is the same for
// every log: nothing that came from a vehicle is in it.
(() => {
  // The page follows the system: viser reads this when it starts.
  const address = new URL(location.href);
  if (matchMedia("(prefers-color-scheme: dark)").matches && !address.searchParams.has("darkMode")) {
    address.searchParams.set("darkMode", "");
    history.replaceState(null, "", address);
  }

  // Space plays: a button that was pressed with the mouse must not be pressed again by it.
  document.addEventListener("click", (event) => {
    if (event.detail > 0) document.activeElement?.closest?.("button")?.blur();
  });

  // A link to the instant shown, with the IMU that is integrated.
  window.companionCopyLink = (button) => {
    const time = document.querySelector(".companion-time")?.parentElement?.nextElementSibling;
    const seconds = time?.querySelector("input[type=text], input[inputmode]")?.value;
    const imu = document.querySelector("[data-companion-imu]")?.dataset.companionImu;
    const link = new URL("./", location.origin + location.pathname);
    if (seconds) link.searchParams.set("t", seconds);
    if (imu) link.searchParams.set("imu", imu);
    const said = button.textContent;
    const done = () => { button.textContent = "copied"; setTimeout(() => { button.textContent = said; }, 1500); };
    if (navigator.clipboard) navigator.clipboard.writeText(link.href).then(done, () => prompt("Link", link.href));
    else prompt("Link", link.href); // a page that is not served to this computer alone may not write there
  };

  // Say when companion has ended; viser connects again by itself when it is back.
  const ALIVE = "companion-alive", EVERY_MS = 3000;
  let missed = 0;
  const say = (text) => {
    let box = document.getElementById("companion-ended");
    if (!text) return box?.remove();
    if (!box) {
      box = document.createElement("div");
      box.id = "companion-ended";
      box.setAttribute("role", "status");
      box.style.cssText = "position:fixed;z-index:10000;left:50%;top:40%;transform:translateX(-50%);padding:16px 24px;" +
        "max-width:90vw;background:#333;color:#fff;font:18px sans-serif;border-radius:6px";
      document.body.appendChild(box);
    }
    box.textContent = text;
  };
  const look = async () => {
    try {
      const answer = await fetch(ALIVE, { cache: "no-store" });
      missed = 0;
      say(answer.status === 403 ? "companion runs again with another token: open the address that it prints." : "");
    } catch {
      missed += 1;
      if (missed >= 2) say("companion has ended. Start it again: this page returns by itself.");
    }
    setTimeout(look, EVERY_MS);
  };
  setTimeout(look, EVERY_MS);
})();
