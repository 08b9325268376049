// Where the page is outside of episodes: the server's screen, or one that an input leads to and the server sent before.
// It touches no element and sends nothing; what the server says counts.

export class Onward {
  constructor() {
    this.clear();
  }

  clear() {
    this.screens = new Map(); // name -> {name, screen, after, episode, scene}
    this.edges = new Map(); // name -> input -> name
    this.told = null; // the server's screen
    this.trail = []; // {n, to}: inputs that it has not heard of, and where they led
    this.at = 0; // the name of what is shown
    this.seen = Infinity; // when it was there, ns
    this.lost = 0; // an input whose end is not known: nothing is known until the server has heard of it
  }

  get ahead() {
    return this.trail.length > 0;
  }

  learn(m) {
    for (const screen of m.screens) this.screens.set(screen.name, screen);
    for (const [from, input, to] of m.edges) {
      if (!this.edges.has(from)) this.edges.set(from, new Map());
      this.edges.get(from).set(input, to);
    }
  }

  sawAt(name, flip) {
    if (name === this.at) this.seen = flip;
  }

  // An input at a time went to the server as message n: the screen it leads to, or null where that is not known.
  took(n, input, at) {
    const known = this.lost || !(at >= this.seen) ? undefined : this.edges.get(this.at)?.get(input);
    const screen = this.screens.get(known);
    if (!screen) {
      this.lost = n;
      return null;
    }
    this.trail.push({ n, to: known });
    if (known === this.at) return null;
    this.at = known;
    this.seen = Infinity;
    return screen;
  }

  unknown(n) {
    this.lost = n;
  }

  // The server shows a screen: whether the page has to, or was there already.
  tell(m) {
    const passed = this.pass(m.through);
    this.told = m;
    return passed?.to === m.name && (this.ahead || this.at === m.name) ? false : this.stay();
  }

  // The server has heard of everything up to a message, and has said where that led.
  heard(through) {
    this.pass(through);
    return this.told !== null && !this.ahead && this.at !== this.told.name && this.stay();
  }

  pass(through) {
    const passed = this.trail.findLast((step) => step.n <= through);
    this.trail = this.trail.filter((step) => step.n > through);
    if (this.lost <= through) this.lost = 0;
    return passed;
  }

  stay() {
    this.trail = [];
    this.at = this.told.name;
    this.seen = Infinity;
    return true;
  }
}
