// Links to a state of the page, and storage of a tab. The part of an address after # reaches no log.
const LONGEST = 9000;

// The link in the part of an address after #; longer ones are cut, and refused by the server.
export const linkIn = (hash) => hash.slice(1, LONGEST);

export const addressOf = ({ origin, pathname }, link) => `${origin}${pathname}#${link}`;

// Entries by key with one set (undefined: removed); beyond `most` entries, the oldest are dropped.
export function remember(entries, key, value, most) {
  const { [key]: _, ...others } = entries;
  const kept = Object.entries(others).slice(1 - most);
  return Object.fromEntries(value === undefined ? kept : [...kept, [key, value]]);
}

// Storage of this tab, as plain data; nothing is stored if storage is blocked or full.
export function makeTabStorage(storage, prefix = "eclsim-") {
  let isClosed = false;
  return {
    read(name) {
      try {
        return JSON.parse(storage().getItem(prefix + name) ?? "null");
      } catch {
        return null;
      }
    },
    keep(name, data) {
      if (isClosed) return;
      try {
        storage().setItem(prefix + name, JSON.stringify(data));
      } catch {
        // the page continues without storage
      }
    },
    // Everything is removed, and nothing is stored any more.
    forget() {
      isClosed = true;
      try {
        const stored = storage();
        const names = Array.from({ length: stored.length }, (_, k) => stored.key(k));
        for (const name of names) if (name.startsWith(prefix)) stored.removeItem(name);
      } catch {
        // storage is blocked: nothing is there
      }
    },
  };
}
