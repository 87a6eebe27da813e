// Dark where the reader's system is, before anything is painted; the button switches. Who draws listens to "theme".
const system = matchMedia("(prefers-color-scheme: dark)"), shell = document.documentElement;
const setTheme = dark => { shell.classList.toggle("dark", dark); dispatchEvent(new Event("theme")); };
setTheme(system.matches);
system.addEventListener("change", () => setTheme(system.matches));
addEventListener("click", e => { if (e.target.closest("button.theme")) setTheme(!shell.classList.contains("dark")); });
