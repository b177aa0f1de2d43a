// viser writes names black on white on a dark page too. Their two shaders get the theme as a number. It stands in the head
// of the page that is served and of the one that is saved.
(() => {
  const gl = WebGL2RenderingContext.prototype, { shaderSource, useProgram } = gl, themes = new WeakMap();
  const GROUND = "vec4(1.0, 1.0, 1.0, 0.85 * vAlpha)", LETTER = "vec4(0.0, 0.0, 0.0, a)";
  gl.shaderSource = function (shader, source) {
    if (source.includes(GROUND) || source.includes(LETTER)) {
      source = source.replace("void main()", "uniform float companionDark;\nvoid main()")
        .replace(GROUND, "vec4(vec3(1.0 - 0.9 * companionDark), (0.85 - 0.25 * companionDark) * vAlpha)")
        .replace(LETTER, "vec4(vec3(0.85 * companionDark), a)");
    }
    shaderSource.call(this, shader, source);
  };
  gl.useProgram = function (program) {
    useProgram.call(this, program);
    if (!program) return;
    if (!themes.has(program)) themes.set(program, this.getUniformLocation(program, "companionDark"));
    const theme = themes.get(program);
    if (theme) this.uniform1f(theme, document.documentElement.dataset.mantineColorScheme === "dark" ? 1 : 0);
  };
})();
