// Time: the server's clock, the display's refresh, and what the fish do between two ticks. No part of
// it knows the page: the caller passes the time.

const SLEW = 0.01;    // s/s by which the map of the clocks is bent at most
const ANOTHER_S = 0.5;  // by which another server's clock is off
const PINGS = 16;     // that the best one is taken of
const INTERVALS = 121;  // between frames, that the display's own is taken of
const GAIN = 0.05;    // share of a frame's deviation that the grid follows

// From the page's clock (ms) to the server's (s). The map is bent, it never jumps.
class Clock {
  constructor() { this.pings = []; this.from = 0; this.offset = null; this.target = 0; this.anew = true; }

  // A ping sent and received at these ms of the page, answered at `now` s of the server.
  ping(sent, now, received) {
    const one = {trip: received - sent, offset: now - (sent + received) / 2000};
    this.pings.push(one);
    if (this.pings.length > PINGS) this.pings.shift();
    const best = this.pings.reduce((a, b) => b.trip < a.trip ? b : a);
    const other = this.anew && (!this.known || Math.abs(best.offset - this.offset) > ANOTHER_S);
    this.offset = other ? best.offset : this._offset(received);
    this.anew = false;
    this.from = received; this.target = best.offset;
  }

  // Take the best map at once: while nothing is shown, nothing can jump.
  settle() { if (this.known) this.offset = this.target; }

  get known() { return this.offset !== null; }

  _offset(ms) {
    const most = SLEW * Math.max(ms - this.from, 0) / 1000;
    return this.offset + Math.min(Math.max(this.target - this.offset, -most), most);
  }

  at(ms) { return ms / 1000 + (this.known ? this._offset(ms) : 0); }

  // The connection was lost: the next server may be another one, with another clock.
  renew() { this.pings = []; this.anew = true; }
}

// The display's refresh: the even grid that frames lie on, and how many were left out.
class Refresh {
  constructor() { this.intervals = []; this.last = null; this.ideal = 0; this.period = 1000 / 60; }

  // A frame began at this ms, as the browser says: when it should have, and frames dropped before.
  frame(ms) {
    if (this.last === null) {
      this.last = this.ideal = ms;
      return {ideal: ms, dropped: 0};
    }
    const interval = ms - this.last;
    if (interval > 0) {
      this.intervals.push(interval);
      if (this.intervals.length > INTERVALS) this.intervals.shift();
      this.period = periodOf(this.intervals);
    }
    const passed = Math.max(1, Math.round(interval / this.period));
    this.last = ms;
    this.ideal += passed * this.period;
    const off = ms - this.ideal;
    this.ideal = Math.abs(off) > this.period / 2 ? ms : this.ideal + GAIN * off;
    return {ideal: this.ideal, dropped: passed - 1};
  }

  // A pause, of a page that was hidden, is no dropped frame.
  rest() { this.last = null; }
}

// The time of one frame, of intervals of one or more frames: the median says how many each has.
function periodOf(intervals) {
  const median = intervals.slice().sort((a, b) => a - b)[intervals.length >> 1];
  const frames = intervals.map(one => Math.max(1, Math.round(one / median)));
  return intervals.reduce((a, b) => a + b) / frames.reduce((a, b) => a + b);
}

function turned(from, to, share) {  // the shorter way
  const apart = to - from - 2 * Math.PI * Math.round((to - from) / (2 * Math.PI));
  const angle = from + share * apart;
  return angle - 2 * Math.PI * Math.round(angle / (2 * Math.PI));
}

// The states of `fish` fish, `width` numbers each, between ticks that come one after the other.
class Motion {
  constructor(fish, width, rate) { Object.assign(this, {fish, width, rate}); this.clear(); }

  // shows: whether the first tick has been due; then there is always something to show.
  clear() { this.keys = []; this.seq = 0; this.shows = false; }

  // Go on from what is displayed now, whatever was to come.
  hold(now) {
    if (!this.shows) return this.clear();
    const states = new Float32Array(this.fish * this.width);
    this.at(now, states);
    this.seq = 0;
    this.keys = [{seq: 0, tick: -Infinity, t: now, states}];
  }

  // The states of a tick arrive at `now` s, due at `due` s; cut: those of it and later are void. What
  // comes too late, or is to be reached very soon, is reached in half a tick; jump: at once.
  rows({seq, tick, due, cut, jump}, states, now) {
    const whole = new Float32Array(this.fish * this.width);
    for (let i = 0; i < this.fish; i++) whole[i * this.width + STATE.picture] = -1;
    whole.set(states.subarray(0, Math.min(states.length, whole.length)));
    if (jump) {
      this.keys = [{seq, tick, t: now, states: whole}];
      this.shows = true;
      return;
    }
    const late = due <= now, soonest = now + 0.5 / this.rate;
    const key = {seq, tick, t: cut || late ? Math.max(due, soonest) : due, states: whole};
    const last = this.keys[this.keys.length - 1];
    if (last && !cut && !late && last.t > now && last.t < key.t) {
      this.keys.push(key);
      return;
    }
    // The way from what is displayed now is a new one: it begins here.
    const here = this.shows ? {seq: 0, tick: -Infinity, t: now, states: new Float32Array(whole.length)} : null;
    if (here) here.seq = this.at(now, here.states);
    this.keys = this.keys.filter(one => one.t < (late ? now : key.t) && one.tick < tick);
    const end = this.keys[this.keys.length - 1];
    if (here && (!end || end.t <= now)) this.keys.push(here);
    this.keys.push(key);
  }

  // Write the states at t s, which does not go back; the number of the last `rows` in them.
  at(t, states) {
    const {keys} = this;
    this.shows = keys.length > 0 && (this.shows || t >= keys[0].t);
    if (!this.shows) {
      states.fill(0);
      for (let i = 0; i < this.fish; i++) states[i * this.width + STATE.picture] = -1;
      return this.seq;
    }
    while (keys.length > 1 && keys[1].t <= t) keys.shift();
    const [a, b] = keys;
    const share = b && t > a.t ? (t - a.t) / (b.t - a.t) : 0;
    if (share > 0) for (let i = 0; i < this.fish; i++) this._between(a.states, b.states, share, i * this.width, states);
    else states.set(a.states);
    this.seq = Math.max(this.seq, a.seq, share > 0 ? b.seq : 0);
    return this.seq;
  }

  _between(a, b, share, from, states) {
    const near = share < 0.5 ? a : b, to = from + this.width;
    const both = a[from + STATE.picture] >= 0 && b[from + STATE.picture] >= 0;
    for (let i = from; i < to; i++) {
      const number = i - from, whole = number >= STATE.picture && number <= STATE.look;
      states[i] = whole || !both ? near[i] : a[i] + share * (b[i] - a[i]);
    }
    if (both) states[from + STATE.heading] = turned(a[from + STATE.heading], b[from + STATE.heading], share);
  }
}
