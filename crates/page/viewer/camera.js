// An orbit around a point. Y is up, +Z the front, as glTF has it. Matrices are column by column.

const FIELD = 0.25 // half the opening angle as a tangent: a long lens, as the program's own pictures have it
const FLATTEST = Math.PI / 2 - 1e-3

export class Camera {
  /**
   * - `bounds`: corners of a box around all that is drawn
   * - `frame`: those of the box that is seen at first
   */
  constructor(bounds, frame) {
    const ball = ([low, high]) => {
      const half = high.map((x, k) => (x - low[k]) / 2)
      return { middle: low.map((x, k) => x + half[k]), half, radius: Math.max(1e-6, Math.hypot(...half)) }
    }
    this.all = ball(bounds)
    Object.assign(this, ball(frame))
    this.reset()
  }

  reset() {
    this.target = [...this.middle]
    this.azimuth = (35 * Math.PI) / 180
    this.elevation = (25 * Math.PI) / 180
    // As far away as the corner asks for that is the widest or the nearest.
    const [right, up, toward] = this.axes().map((axis) => axis.map((x, k) => x * this.half[k]))
    const sums = (axis) => [...Array(8).keys()].map((c) => axis.reduce((sum, x, k) => sum + ((c >> k) & 1 ? x : -x), 0))
    const [xs, ys, zs] = [sums(right), sums(up), sums(toward)]
    this.distance = Math.max(this.radius * 1e-2, ...zs.map((z, c) => (1.06 * Math.max(Math.abs(xs[c]), Math.abs(ys[c]))) / FIELD + z))
  }

  turn(right, up) {
    this.azimuth -= right
    this.elevation = Math.min(FLATTEST, Math.max(-FLATTEST, this.elevation + up))
  }

  /** Moves the target, in heights of the picture. */
  move(right, up) {
    const [x, y] = this.axes()
    const step = 2 * FIELD * this.distance
    this.target = this.target.map((t, k) => t - step * (right * x[k] + up * y[k]))
  }

  closer(factor) {
    this.distance = Math.min(this.all.radius * 100, Math.max(this.radius * 1e-3, this.distance / factor))
  }

  /** Right, up and toward the eye. */
  axes() {
    const [sa, ca, se, ce] = [Math.sin(this.azimuth), Math.cos(this.azimuth), Math.sin(this.elevation), Math.cos(this.elevation)]
    return [[ca, 0, -sa], [-sa * se, ce, -ca * se], [sa * ce, se, ca * ce]]
  }

  eye() {
    const toward = this.axes()[2]
    return this.target.map((t, k) => t + this.distance * toward[k])
  }

  /** Pixels that a length at distance 1 takes in a picture of that height. */
  static pixels(height) {
    return height / (2 * FIELD)
  }

  clipFromWorld(width, height) {
    const [x, y, z] = this.axes()
    const eye = this.eye()
    const away = Math.hypot(...eye.map((e, k) => e - this.all.middle[k]))
    const near = Math.max(away - 1.1 * this.all.radius, this.distance * 0.01)
    const far = Math.max(away + 1.1 * this.all.radius, near * 2)
    // The shorter side has the field, so that a phone held upright sees all as well.
    const narrow = Math.min(1, width / height)
    const [sx, sy] = [narrow / FIELD / (width / height), narrow / FIELD]
    const [a, b] = [(far + near) / (near - far), (2 * far * near) / (near - far)]
    const dot = (axis) => axis.reduce((sum, v, k) => sum + v * eye[k], 0)
    const [ex, ey, ez] = [dot(x), dot(y), dot(z)]
    return [0, 1, 2].flatMap((k) => [sx * x[k], sy * y[k], a * z[k], -z[k]]).concat([-sx * ex, -sy * ey, -a * ez + b, ez])
  }
}
