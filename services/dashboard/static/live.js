// Renews the parts of a page that the server sends anew, and keeps the keyboard's focus where it was.

const REFUSED_PAUSE_MS = 1500;
const address = document.body.dataset.live;
const lost = document.querySelector(".link-lost");

export const ZONED = new Intl.DateTimeFormat("sv-SE", { year: "numeric", month: "2-digit", day: "2-digit", hour: "2-digit", minute: "2-digit", second: "2-digit", timeZoneName: "shortOffset" });

// Moments in the reader's own time zone, with its offset.
function localised(element) {
  for (const time of element.querySelectorAll("time[datetime]")) {
    const at = new Date(time.dateTime);
    time.title = time.title || time.textContent;
    if (!Number.isNaN(at.getTime())) time.textContent = ZONED.format(at).replace("GMT", "UTC");
  }
}

function renew(name, html) {
  const element = document.getElementById(name);
  if (!element || element.dataset.part === undefined) return;
  // What looks the same is left alone: a screen reader need not say it again.
  const made = document.createElement(element.tagName);
  made.innerHTML = html;
  localised(made);
  if (made.innerHTML === element.innerHTML) return;
  const focused = element.contains(document.activeElement) ? document.activeElement.id : "";
  const scrolled = element.querySelector(".scroll")?.scrollLeft ?? 0;
  element.replaceChildren(...made.childNodes);
  const scroll = element.querySelector(".scroll");
  if (scroll) scroll.scrollLeft = scrolled;
  if (focused) document.getElementById(focused)?.focus({ preventScroll: true });
}

function follow() {
  const source = new EventSource(address);
  source.addEventListener("open", () => (lost.hidden = true));
  source.addEventListener("error", () => {
    lost.hidden = false;
    // The server answered and gave no stream: the page itself will say why, perhaps that one must sign in again.
    if (source.readyState === EventSource.CLOSED) setTimeout(() => location.reload(), REFUSED_PAUSE_MS);
  });
  source.addEventListener("parts", (event) => {
    for (const [name, html] of Object.entries(JSON.parse(event.data))) renew(name, html);
    document.body.dataset.renewed = String(Number(document.body.dataset.renewed ?? 0) + 1);
  });
  source.addEventListener("anew", () => {
    source.close();
    location.reload();
  });
  // A page that was left needs no stream; one that the browser brings back as it was needs a new one.
  addEventListener("pagehide", () => source.close(), { once: true });
  addEventListener("pageshow", (event) => event.persisted && location.reload(), { once: true });
}

for (const button of document.querySelectorAll("[data-copies]"))
  button.addEventListener("click", () => {
    const source = document.getElementById(button.dataset.copies);
    source.select?.();
    navigator.clipboard?.writeText(source.value ?? source.textContent).then(() => (button.textContent = "Copied"), () => {});
  });
localised(document);
if (address) follow();
