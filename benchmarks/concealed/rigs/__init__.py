"""Random rigs: plants whose very topology is drawn, so that no rule can have been fitted to them.

`drawn.rig` draws a plant like the four of `benchmarks.concealed.plants`; everything about it follows from a seed.

* One to four bodies in a chain, turning (three of four) or sliding; each follows the one before rigidly, behind a gear
  (ratio 1 to 200, two of five with losses, half with an inertia), a spring, or a belt (a spring and a gear). Three of
  four turning rigs with more than one body end in a flexible link.
* Driven by a voltage on a DC motor (two of five of them with a known inductance), a current, a torque or a force.
* One to three sensors on drawn bodies: encoder of 200 counts to 20 bit, linear scale, gyroscope or analog speed,
  tachometer, accelerometer, strain gauge, position or acceleration of the tip. One sensor of motion in two is read by
  the scenario at another flange of the same rigid node, as a user may map it.
* 100 Hz to 5 kHz, 2 to 30 s, 400 to 10 000 rows; two to five recordings to fit and one to four of other kinds to hold
  out; a third under a controller with the plant's input logged; half of the open ones with a spring may begin twisted;
  a quarter have jitter in the time stamps, of up to 20 % of an interval but no more than half a floor in any signal.
* The data sheet is off by up to 10 % (damping 30 %); in two rigs of five one badly known parameter by up to 30 %.

`hidden.drawn` draws what it conceals.

A rig can be asked to have what an effect of a drive needs (`topology.PARTS`). It then has a stream of its own, so that
what a seed draws without it stays what it is:

* ``rig-SEED-belt``: the first body turns, and pulls slides by a pulley (radius 8 to 40 mm) and a toothed belt of which
  the scenario declares no pretension;
* ``rig-SEED-motor``: a voltage on a motor whose losses are those of winding and bearing, with one constant for torque
  and back-emf and no known inductance, so that its heat can be concealed;
* ``rig-SEED-gear``: an elastic gear without losses (ratio 3 to 160) behind the first body.

Stops are concealed where a position is measured, friction that warms up in any bearing or guide: every rig may have
these.

Left out, and why:

* *screw, rack, and bodies that turn beside others that slide*, but for the belt that is asked for; *a flexible link on
  a slide*: no block;
* *on slides* hardening, hysteresis, structural damping, ripple, outside vibration, a further mode and gravity: their
  blocks only turn (a scenario could not be written that undoes them);
* *gravity in the nominal model, closed loops of bodies, two drives*: the chain of bodies has none;
* *5 kHz for 30 s*: rows are limited, since a hundred such diagnoses would take days.
"""
