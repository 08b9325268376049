// Runs in the frame of a preview before the participant's page. That page takes the focus when a screen is drawn, which
// in a frame takes it from the form in which a person writes, and their keys with it; and without the focus it pauses.
// Here it leaves the focus alone and shows its screen, until the person has clicked or pressed a key in the frame.
{
  const { focus } = HTMLElement.prototype;
  const hasFocus = document.hasFocus.bind(document);
  let isEntered = false;
  for (const name of ["pointerdown", "keydown"]) addEventListener(name, () => { isEntered = true; }, { capture: true, once: true });
  document.hasFocus = () => !isEntered || hasFocus();
  /** @param {FocusOptions} [options] */
  HTMLElement.prototype.focus = function (options) {
    if (isEntered && hasFocus()) focus.call(this, options);
  };
}
