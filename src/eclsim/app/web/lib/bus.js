// Messages by topic, from the server to the views and between views.
export function makeBus() {
  const listeners = new Map();
  const latest = new Map();
  return {
    publish(topic, data) {
      latest.set(topic, data);
      for (const listener of listeners.get(topic) ?? []) listener(data);
    },
    // Calls `listener` with every message of a topic, and at once with the last; returns a function to stop.
    on(topic, listener) {
      if (!listeners.has(topic)) listeners.set(topic, new Set());
      listeners.get(topic).add(listener);
      if (latest.has(topic)) listener(latest.get(topic));
      return () => listeners.get(topic).delete(listener);
    },
    last: (topic) => latest.get(topic),
  };
}

// The bands of a posterior if they were computed for the beat or ramp that is shown; they are of the start.
export const bandsFor = (bands, shown) =>
  bands?.count && shown && bands.of === shown.of && !shown.minute ? bands : undefined;

const MOST_TIMES = 2000;

// Times from the change of a control to the repainted page [ms].
export function makeLatency(clock, nextFrame) {
  const sent = new Map();
  const times = [];
  return {
    times,
    start: (seq) => sent.set(seq, clock()),
    // The beat of a change is drawn: earlier changes were superseded and have no time of their own.
    drawn(seq) {
      for (const [turn, since] of sent) {
        if (turn > seq) continue;
        sent.delete(turn);
        if (turn < seq) continue;
        nextFrame(() => {
          times.push(clock() - since);
          if (times.length > MOST_TIMES) times.splice(0, MOST_TIMES / 2);
        });
      }
    },
  };
}
