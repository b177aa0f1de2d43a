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

  // The buttons of the transport press the keys that the page listens to.
  const KEYS = { space: " ", arrowleft: "ArrowLeft", arrowright: "ArrowRight", arrowup: "ArrowUp", arrowdown: "ArrowDown",
    pageup: "PageUp", pagedown: "PageDown", home: "Home", end: "End" };
  window.companionKey = (name, shiftKey) => {
    const key = KEYS[name] ?? name.toLowerCase();
    const code = key === " " ? "Space" : KEYS[name] ?? `Key${name}`;
    document.body.dispatchEvent(new KeyboardEvent("keydown", { key, code, shiftKey, bubbles: true }));
  };

  let missed = 0; // questions whether companion is there, one after the other

  const shownTime = () => document.querySelector(".companion-time")?.parentElement?.nextElementSibling
    ?.querySelector("input[type=text], input[inputmode]")?.value;
  const shownImu = () => document.querySelector("[data-companion-imu]")?.dataset.companionImu;

  // A link to the instant shown, with the IMU that is integrated.
  window.companionCopyLink = (button) => {
    const link = new URL("./", location.origin + location.pathname);
    if (shownTime()) link.searchParams.set("t", shownTime());
    if (shownImu()) link.searchParams.set("imu", shownImu());
    const said = button.textContent;
    const done = () => { button.textContent = "copied"; setTimeout(() => { button.textContent = said; }, 1500); };
    if (navigator.clipboard) navigator.clipboard.writeText(link.href).then(done, () => prompt("Link", link.href));
    else prompt("Link", link.href); // a page that is not served to this computer alone may not write there
  };

  // The last view of each log: its instant and IMU, the tab and the camera that were chosen. It stays in this browser.
  const VIEWS = "companion-views", MOST_VIEWS = 50, REMEMBERED = "companion-remembered";
  const CAMERAS = ["Fit all", "Follow both", "Map"];
  let restored = "", chosen = {};
  const views = () => { try { return JSON.parse(localStorage.getItem(VIEWS)) || {}; } catch { return {}; } };
  const pressed = (selector, text) =>
    [...document.querySelectorAll(selector)].find((one) => one.textContent.trim() === text)?.click();
  document.addEventListener("click", (event) => {
    const tab = event.target.closest?.("[role=tab]"), button = event.target.closest?.("button");
    if (tab) chosen.tab = tab.textContent.trim();
    else if (button && CAMERAS.includes(button.textContent.trim())) chosen.camera = button.textContent.trim();
  });
  const remember = async () => {
    const log = document.querySelector("[data-companion-log]")?.dataset.companionLog;
    if (!log || !shownTime() || missed) return;
    const known = views();
    if (restored !== log) {
      const { t, imu, tab, camera } = known[log] ?? {};
      if (t && !restored) {
        await fetch(`${REMEMBERED}?${new URLSearchParams({ t, imu: imu ?? "" })}`,
          { cache: "no-store", headers: { "Companion-Page": "1" } }).catch(() => {});
      }
      if (tab && !restored) pressed("[role=tab]", tab);
      if (camera && !restored) pressed("button", camera);
      restored = log;
      return;
    }
    delete known[log]; // the newest is the last
    known[log] = { ...chosen, t: shownTime(), imu: shownImu() };
    const kept = Object.fromEntries(Object.entries(known).slice(-MOST_VIEWS));
    try { localStorage.setItem(VIEWS, JSON.stringify(kept)); } catch { /* a browser that keeps nothing */ }
  };
  setInterval(remember, 2000);

  // viser asks for a new WebSocket every second, whether anyone is there or not. Browsers let a page that was refused
  // again and again wait for seconds before the next one, which viser gives up after one: after half a minute none would
  // ever open. So it asks only when companion answers, and a WebSocket has time to open.
  const ALIVE = "companion-alive", OPENS_MS = 2000;
  const post = Worker.prototype.postMessage;
  let asking = false;
  Worker.prototype.postMessage = function (message, ...others) {
    if (message?.type !== "retry") return post.call(this, message, ...others);
    if (asking) return;
    asking = true;
    fetch(ALIVE, { cache: "no-store" }).then((answer) => {
      if (answer.ok) post.call(this, message, ...others);
      setTimeout(() => { asking = false; }, answer.ok ? OPENS_MS : 0);
    }, () => { asking = false; });
  };

  // Say when companion has ended; the page connects again by itself when it is back.
  const EVERY_MS = 3000;
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
      restored = ""; // what is shown when it is back is new again
      if (missed >= 2) say("companion has ended. Start it again: this page returns by itself.");
    }
    setTimeout(look, EVERY_MS);
  };
  setTimeout(look, EVERY_MS);
})();
