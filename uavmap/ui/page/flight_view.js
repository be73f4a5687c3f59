// The flight in the browser: one canvas for the map, one for the latest picture, a table of the
// aircraft, the figures, the log. The server calls `setScene` once, and `applyDelta` for each change.

import { inkOn } from "flight_board";
import { FlightMap } from "flight_map";

const SILENT_S = 6;
const AGAIN_S = 5; // time between two sounds of an alarm until it is acknowledged

const clock = (seconds) => {
  if (seconds === null || seconds === undefined) return "";
  const s = Math.max(0, Math.round(seconds));
  const two = (n) => String(n).padStart(2, "0");
  const hours = Math.floor(s / 3600);
  return (hours ? hours + ":" : "") + two(Math.floor(s / 60) % 60) + ":" + two(s % 60);
};

const known = (value) => value !== null && value !== undefined;
const metres = (m) => (Math.round(m) || 0) + " m"; // never -0

// two short tones; a browser stays silent until the first click on its page
class Sound {
  constructor() {
    this.times = 0; // number of requests
    const allow = () => {
      this.context = this.context || new AudioContext();
      this.context.resume();
    };
    document.addEventListener("pointerdown", allow);
    document.addEventListener("keydown", allow);
  }

  play() {
    this.times += 1;
    if (!this.context || this.context.state !== "running") return;
    const begin_s = this.context.currentTime;
    [880, 660].forEach((hertz, i) => {
      const tone = new OscillatorNode(this.context, { frequency: hertz });
      const volume = new GainNode(this.context, { gain: 0.2 });
      tone.connect(volume).connect(this.context.destination);
      tone.start(begin_s + 0.25 * i);
      tone.stop(begin_s + 0.25 * i + 0.2);
    });
  }
}

// --- the page -----------------------------------------------------------------------------------
export default {
  template: `
  <div class="flight">
    <div class="flight-alarms" v-if="alarms.length" role="alert" :class="{ known: !open.length }">
      <ul>
        <li v-for="[key, words] in alarms" :key="key" :class="{ known: acknowledged.has(key) }">{{ words }}</li>
      </ul>
      <button v-if="open.length" type="button" @click="acknowledge">Acknowledge</button>
    </div>
    <div class="flight-banner" v-if="banner" role="alert">{{ banner }}</div>
    <div class="flight-map">
      <canvas ref="map" tabindex="0" aria-label="map of the flight"></canvas>
      <svg class="flight-north" viewBox="0 0 24 40" role="img" aria-label="north is up">
        <path d="M12 1 L20 24 L12 19 L4 24 Z"></path><text x="12" y="38" text-anchor="middle">N</text>
      </svg>
      <button class="flight-fit" type="button" @click="fit">whole map</button>
      <ul class="flight-legend" v-if="scene">
        <li v-for="[name, colour] in scene.states" :key="name">
          <span :style="{ background: colour }"></span>{{ name }}
        </li>
        <li v-for="line in scene.lines" :key="line.name">
          <svg aria-hidden="true" viewBox="0 0 28 12"><line x1="0" y1="6" x2="28" y2="6" :stroke="line.colour" stroke-width="2" :stroke-dasharray="line.dash"></line></svg>{{ line.name }}
        </li>
        <li v-for="(name, mark) in scene.marks" :key="mark">
          <svg aria-hidden="true" viewBox="0 0 28 12" :stroke="scene.tracks[1]">
            <line v-if="mark === 'track'" x1="0" y1="6" x2="28" y2="6" stroke-width="1.5"></line>
            <line v-else-if="mark === 'ahead'" x1="0" y1="6" x2="28" y2="6" stroke-width="2" stroke-dasharray="2 4"></line>
            <circle v-else-if="mark === 'flying'" cx="14" cy="6" r="5" :fill="scene.tracks[1]" stroke="#fff"></circle>
            <circle v-else-if="mark === 'landed'" cx="14" cy="6" r="4.5" fill="#fff" stroke-width="2"></circle>
            <path v-else-if="mark === 'traffic'" d="M14 1 L19 6 L14 11 L9 6 Z" :fill="scene.traffic" stroke="none"></path>
            <circle v-else v-for="[r, colour] in scene.home_mark" cx="14" cy="6" :r="0.85 * r" :fill="colour" stroke="none"></circle>
          </svg>{{ name }}
        </li>
      </ul>
    </div>
    <div class="flight-side">
      <ul class="flight-vehicles" v-if="rows.length" tabindex="0" aria-label="vehicles">
        <li v-for="row in rows" :key="row.number" :class="row.phase">
          <span class="flight-dot" :style="{ background: row.colour, color: row.ink }">{{ row.number }}</span>
          <b>{{ row.doing }}</b>
          <span class="flight-battery" :class="{ low: row.low }">
            <span class="flight-bar"><i :style="{ width: row.battery + '%' }"></i></span>{{ row.charge }}
          </span>
          <dl>
            <div v-for="[name, value] in row.figures" :key="name"><dt>{{ name }}</dt> <dd>{{ value }}</dd></div>
          </dl>
        </li>
      </ul>
      <dl class="flight-figures">
        <template v-for="[name, value] in figures" :key="name">
          <dt>{{ name }}</dt><dd>{{ value }}</dd>
        </template>
      </dl>
      <figure class="flight-picture">
        <canvas ref="picture" v-show="pictured"></canvas>
        <figcaption>{{ caption }}</figcaption>
      </figure>
      <figure class="flight-picture" v-if="judged">
        <img :src="judged" alt="a judged picture">
        <figcaption>Red outlines: ground that the detector rates as region, in the first picture with region, else in the first picture</figcaption>
      </figure>
      <ol class="flight-log" aria-label="log" tabindex="0">
        <li v-for="[number, t, level, text] in lines" :key="number" :class="level">
          <time>{{ clock(t) }}</time> {{ text }}
        </li>
      </ol>
    </div>
  </div>`,
  data() {
    return { scene: null, figures: [], rows: [], lines: [], banner: "", alarms: [], acknowledged: new Set(), caption: "", pictured: false, judged: "" };
  },
  computed: {
    open() {
      return this.alarms.filter(([key]) => !this.acknowledged.has(key));
    },
  },
  mounted() {
    this.map = new FlightMap(this.$refs.map);
    window.flightSound = this.sound = new Sound();
    window.flightMap = this.map; // for tests and inspection
    this.map.onresults = (asked) => {
      const image = new Image();
      image.onload = () => (this.judged = image.src);
      image.src = "result/judged.jpg?" + asked;
    };
    this.updated_ms = performance.now();
    this.sound_ms = 0;
    this.timer = setInterval(() => this.check(), 1000);
  },
  unmounted() {
    clearInterval(this.timer);
    this.map.over = true;
  },
  methods: {
    clock,
    fit() {
      this.map.touched = false;
      this.map.fit();
    },
    setScene(scene) {
      this.scene = scene;
      this.map.setScene(scene);
    },
    // apply a delta and the state of the link; returns the version that is shown, 0 if a snapshot is
    // needed
    applyDelta(delta, link) {
      this.updated_ms = performance.now();
      this.link = link;
      document.body.classList.toggle("flight-ended", !!link.text);
      if (link.text) window.socket?.io.reconnection(false); // the server ends now
      this.check();
      if (!this.scene || !this.map.applyDelta(delta)) return 0;
      const board = this.map.board;
      if (Object.keys(delta.vehicles).length) this.listVehicles(board);
      if (Object.keys(delta.fields).length) this.listFigures(board.fields);
      if ("alarms" in delta.fields || delta.since === 0) this.listAlarms(board.fields.alarms || []);
      if ("picture" in delta.fields || delta.since === 0) this.showPicture(board.fields.picture);
      if (delta.log.length || delta.since === 0) this.lines = board.log.slice().reverse();
      this.check();
      return board.version;
    },
    check() {
      if (!this.link) return;
      const silent_s = Math.round((performance.now() - this.updated_ms) / 1000);
      const over = this.map.board.fields.over;
      if (this.link.text) this.banner = this.link.text;
      else if (this.link.live && !over && silent_s >= SILENT_S)
        this.banner = "no update for " + silent_s + " s: the page shows an old state";
      else this.banner = "";
      if (this.open.length && performance.now() >= this.sound_ms) this.ring();
    },
    ring() {
      this.sound_ms = performance.now() + 1000 * AGAIN_S;
      if (this.link.sounds) this.sound.play();
    },
    acknowledge() {
      this.alarms.forEach(([key]) => this.acknowledged.add(key));
    },
    // an alarm that ends and starts again needs a new acknowledgement
    listAlarms(alarms) {
      const before = new Set(this.alarms.map(([key]) => key));
      const keys = new Set(alarms.map(([key]) => key));
      for (const key of this.acknowledged) if (!keys.has(key)) this.acknowledged.delete(key);
      this.alarms = alarms;
      if (alarms.some(([key]) => !before.has(key))) this.ring();
    },
    listVehicles(board) {
      this.rows = Object.entries(board.vehicles).map(([number, v]) => ({
        number,
        colour: this.map.colour(number),
        ink: inkOn(this.map.colour(number)),
        doing: v.doing,
        phase: v.phase,
        low: v.low,
        battery: v.battery,
        charge: [Math.round(v.battery) + " %", v.volts ? v.volts.toFixed(1) + " V" : "", v.landed ? "" : clock(v.left_s) + " left"]
          .filter((part) => part)
          .join(", "),
        figures: this.figuresOf(v).filter(([, value]) => value),
      }));
    },
    figuresOf(v) {
      const speed = (m_s) => (known(m_s) ? m_s + " m/s" : "");
      const above = known(v.above_home_m) ? ` (${metres(v.above_home_m)} above home)` : "";
      return [
        ["control", v.control + (v.mode ? ", " + v.mode : "")],
        ["height", v.landed ? "" : metres(v.up) + above],
        ["speed", speed(v.speed_m_s)],
        ["wind", speed(v.wind_m_s)],
        ["home", v.home_m === null ? "" : metres(v.home_m) + ", " + clock(v.home_s)],
        ["camera", v.landed ? "" : `${v.rate_hz}/s` + (v.lost ? `, ${v.lost} lost` : "")],
        ["GPS", known(v.satellites) ? v.satellites + " sat." + (known(v.hdop) ? ", HDOP " + v.hdop.toFixed(1) : "") : ""],
        ["link", known(v.loss_percent) ? v.loss_percent + " % lost, " + v.late_s + " s late" : ""],
        ["sorties", String(v.sorties)],
      ];
    },
    listFigures(f) {
      const rows = [["mission time", clock(f.t_s)], ["phase", f.phase]];
      if (f.known) rows.push(["map", f.known]);
      for (const { words } of (f.traffic || []).slice(0, 5)) rows.push(["traffic", words]);
      rows.push(["region", f.roi + " cells decided"]);
      this.scene.classes.forEach((name, i) => {
        const area_m2 = (f.class_areas_m2 || [])[i];
        if (area_m2) rows.push(["region, " + name, Math.round(area_m2) + " m²"]);
      });
      if (f.frames)
        rows.push(["pictures judged", f.frames[0] + (f.frames[1] ? ", " + f.frames[1] + " lost" : "")]);
      const c = f.certificate;
      if (c && c.lower_bound_s) {
        rows.push(["exploration up to " + clock(c.t_s), clock(c.exploration_s)]);
        rows.push(["lower bound for any team", clock(c.lower_bound_s)]);
        if (c.ratio) rows.push(["ratio of the two", c.ratio.toFixed(2)]);
        if (c.bound_s) rows.push(["bound of the strategy", clock(c.bound_s)]);
      }
      if (f.left && f.left.share !== null)
        rows.push(["done", "about " + Math.floor(100 * f.left.share) + " % of " + f.left.of]);
      if (f.left && f.left.what)
        rows.push(["known rest", f.left.what + (f.left.about_s === null ? "" : ", about " + clock(f.left.about_s))]);
      if (f.over) rows.push(["found", f.finding]);
      this.figures = rows;
    },
    showPicture(picture) {
      this.pictured = !!picture;
      if (!picture) {
        this.caption = this.link && this.link.pictures ? this.link.pictures : "no picture yet";
        return;
      }
      const image = new Image();
      image.onload = () => {
        if (this.map.board.fields.picture !== picture) return; // a newer one is loading
        const yes = picture.cells.filter((cell) => cell[8]).length;
        this.caption = `vehicle ${picture.vehicle} at ${clock(picture.t_s)}: ${yes} of ${picture.cells.length} cells look like region`;
        const canvas = this.$refs.picture;
        const width = (canvas.width = image.naturalWidth);
        const height = (canvas.height = image.naturalHeight);
        const pen = canvas.getContext("2d");
        pen.drawImage(image, 0, 0);
        for (const only of [0, 1])
          for (const cell of picture.cells) {
            if (cell[8] !== only) continue;
            pen.strokeStyle = only ? "#3cc83c" : "#c8c8c8";
            pen.lineWidth = only ? 2.5 : 1.2;
            pen.beginPath();
            for (let i = 0; i < 8; i += 2) pen.lineTo(cell[i] * width, cell[i + 1] * height);
            pen.closePath();
            pen.stroke();
          }
      };
      image.src = "picture/" + encodeURIComponent(picture.id);
    },
  },
};
