() => {
  // A name for this tab's visit, which a reload keeps: nobody can guess it, and it ends with the tab.
  const kept = sessionStorage.getItem("kfit-visit");
  if (kept) return [kept];
  const made = [...crypto.getRandomValues(new Uint8Array(16))].map((byte) => byte.toString(16).padStart(2, "0")).join("");
  sessionStorage.setItem("kfit-visit", made);
  return [made];
}
