"""Words of other packages, and the names to use in their place: one table."""

from collections.abc import Collection
from difflib import get_close_matches

# Rows: words that users may type, compared without underscores and capitals; right names, of which
# `answer` gives the first that the function or object has; and the advice if it has none.
TABLE = (
  ("x0 y0 u0 z0 omega0 ic start initial initialstate initialcondition",
   "x0 omega0 near states[0] state", ""),
  ("omega x state", "x0 omega0 omega x states state components", ""),
  ("body system field fun rhs model", "system body", ""),
  ("f", "first_integral body", ""),
  ("backward reverse inverse", "inverse",
   "step(system, x, -eps), which undoes a step of Kahan's map; of a Map write Map(g, names), with "
   "the inverse g of f"),
  ("arg p param parameter", "parameters",
   "parameters of the field, Field(f, names, a=1), and field.with_parameters(a=2); an "
   "array makes a family"),
  ("withparameters setparameters setparams set replace subs update", "with_parameters",
   "a new system, with the new parameters; arrays make a family"),
  ("frequencyresponse sweep parametersweep resonance family vary scan product", "",
   "flow(field.with_parameters(a=array), x0, time=t), all values of a parameter at once"),
  ("fit curvefit leastsquares estimate minimize optimize", "",
   "scipy.optimize.least_squares with flow(field.with_parameters(a=a), x0, time=t)"),
  ("table lookup lookuptable interp1d input control timeseries zoh zeroorderhold", "",
   "np.interp(t, times, values) or CubicSpline(times, values)(t) in f(t, y); equal neighbours in "
   "times of np.interp are a jump"),
  ("vectorized vectorize", "", "states (..., D), of which each is a trajectory"),
  ("mass massmatrix m", "", "Field(f, names, mass=M), for M(x) x' = f(x)"),
  ("delay lag history dde dde23 ddesd", "",
   "a package for delays, such as DelayDiffEq of Julia: here f has the present state alone"),
  ("noise sde sdeint sdeproblem stochastic brownian diffusion", "",
   "a package for noise, such as diffrax: here equations have none"),
  ("section condition value trigger", "surface",
   "crossings(system, x0, time=T, surface=lambda x: x[..., 0], direction=0), or "
   "events=Event(lambda x: x[0], to=lambda x: ...) of flow, where the state changes there, and "
   "terminal=True in place of to, where it ends"),
  ("crossings", "Events events", "crossings(system, x0, surface, time=T)"),
  ("jump dose impulse dosetime tstop schedule bolus infusion presettime discretecallback",
   "times",
   "events=Event(times=[1, 2], to=lambda x: (x[0] + 1, x[1])) of flow"),
  ("reset bounce bouncing restitution impact contact collision affect effect action spike kick",
   "to",
   "events=Event(lambda x: x[0], direction=-1, to=lambda x: (x[0], -x[1])) of flow"),
  ("callback cb callbackset continuouscallback outputfcn outputfunction", "",
   "events=Event(lambda x: x[0], to=lambda x: ...) of flow, where the state changes, or "
   "progress=f, which is told how far a run is"),
  ("poincare poincaremap poincaresection poincaresos tevents yevents te ye xe ie brentq "
   "returnmap",
   "crossings events", ""),
  ("maxima peak localmaxima extrema", "",
   "crossings(field, x0, time=T, surface=lambda x: -field(x)[..., 0]), maxima of component 0"),
  ("stroboscopic stroboscope stroboscopicmap", "",
   "flow(field, x0, time=T * np.arange(n)), T the period of the force"),
  ("limitcycle cycle bvp4c solvebvp bvp", "", "suslov_fast.periodic_orbit(field, x0)"),
  ("period frequency", "period",
   "periodic_orbit(field, x0).period; orbits of period 2 of a map x -> f(x) are fixed points, "
   "equilibria(Map(lambda x: f(f(x)), names), near=x0)"),
  ("floquet floquetmultipliers multipliers", "multipliers eigenvalues", ""),
  ("monodromy variational", "",
   "flow(field, x0, time=T, derivatives='x0').derivatives['x0'], of which [-1] is that of T"),
  ("count maxevents maxcrossings", "most", ""),
  ("terminal terminate stop stopwhen until firstpassage escape escapetime exittime firsthit "
   "firstreturn", "terminal most",
   "events=Event(lambda x: x[0], terminal=True) of flow, or crossings(system, x0, time=T, "
   "surface=lambda x: x[..., 0], direction=0, most=1)"),
  ("burnin ntransient transienttime ttr discard", "transient", ""),
  ("njobs nworkers workers numthreads setnumthreads setthreads threads cores parallel",
   "threads client", "threads= of each function"),
  ("timeout maxtime budget timelimit", "progress", ""),
  ("verbose tqdm progressbar progress logging", "progress", "progress= of each function"),
  ("seed rng randomstate randomstarts", "",
   "numpy.random.default_rng(seed).uniform(low, high, (n, D)) as states"),
  ("out output csv tocsv toexcel toparquet tosql", "",
   "run.save(path), or run.to_dataframe().to_csv(path)"),
  ("rational fractions kahan", "",
   "map = suslov_fast.integrability.kahan(field, eps), and x = map(x), in fractions"),
  ("y z", "components", "states, of the shape (times, ..., D)"),
  ("figsize xlim ylim xlabel ylabel grid legend", "ax", ""),
  *((f"i{k}{k}", f"I{k}", "") for k in (1, 2, 3)),
  *((f"i3{k}", f"I{k}3", "") for k in (1, 2)),
  ("i inertia inertiamatrix tensor i12 i21", "parameters",
   "from_inertia(I, a), or from_mass_tensor(I, a) in n dimensions"),
  ("u values result data trajectories points shape numpy tonumpy select max min mean", "states",
   "iterate, whose result has states"),
  ("index idx member which", "trajectory", "states[:, i], of trajectory i"),
  ("bytrajectory pertrajectory groupby grouped", "split", ""),
  ("success retcode", "ok", ""),
  ("message error failed failedat", "status", ""),
  ("last end final finalstate laststate", "final states[-1]", ""),
  ("resume restart continue extend", "",
   "iterate(system, run, eps, steps), which goes on from the last states"),
  ("tonetcdf tozarr sel isel", "to_xarray", ""),
  ("savefig figure", "figures plot", "plot().figure.savefig(path)"),
  ("save tojson tofile dump", "save", "json.dump(body.to_dict(), file)"),
  ("equation latex tolatex tosympy sympify", "body",
   "str(...), the formula; of an integral F sympy.sympify(F), and sympy.latex(F)"),
  ("eval evaluate lambdify vectorfield apply observe observable", "values",
   "field(x), the value of the right-hand side; compiled.system in loops of your own"),
  ("dim ndim d", "dimension", ""),
  ("derivatives", "derivatives",
   "map.jacobian(x), multiplied along run.states; of a motion flow(..., derivatives='x0')"),
  ("dx derivative linearize", "derivatives",
   "field.jacobian(x), of its right-hand side; for a body body.field().jacobian(x)"),
  ("type", "kind", ""),
  ("stability isstable linearstability", "stable", "equilibria(system, near=x0).stable"),
  ("eigenvector", "", "np.linalg.eig(field.jacobian(x)), which returns values and vectors"),
  ("eig eigenvalues stable", "eigenvalues multipliers",
   "np.linalg.eigvals(field.jacobian(x)), or multipliers(system, x, eps), of a map"),
  ("variable", "names labels", ""),
  ("solveivp odeint ode integrate solve exactflow ode45 ode15s ode23 ode23s ode113 odeproblem "
   "rk45 dop853 radau bdf lsoda quad", "", "flow(system, x0, time=t)"),
  ("flow iterate", "run", ""),
  ("run trajectory orbit simulate simulation simulator evolve", "run states",
   "suslov_fast.flow(system, x0, time=t), or suslov_fast.iterate along the map"),
  ("orbitdiagram bifurcationdiagram bifurcation hopf fold saddlenode continuation", "",
   "a family, Field(f, names, c=array), and c[points.trajectory] of its crossings; of maps "
   "iterate(Map(f, names, c=array), x0, steps=n)"),
  ("phaseportrait plotphaseportrait pplane phasespace quiver streamplot nullclines nullcline "
   "isocline isoclines vectorfieldplot", "plot_phase",
   "suslov_fast.plot_phase(field, extent=(left, right, low, high)), which draws arrows, nullclines "
   "and equilibria; flow(field, grid, time=t).plot() draws orbits"),
  ("plot3d", "", "plot(a, b, c), with the names of three components"),
  ("plot fplot", "plot",
   "iterate(...).plot(), or flow(field, x0, time=np.linspace(0, T, 201)).plot()"),
  ("sensitivity sensitivities gradient grad adjoint tangent", "",
   "flow(..., derivatives=('x0', 'a')), and derivatives['a'] of its result"),
  ("lyapunov lyapunovspectrum lyap maxlyapunov largestlyapunov ftle sali gali megno",
   "lyapunov_exponents",
   "suslov_fast.lyapunov_exponents(system, x0, time=T), of which [..., 0] is the largest"),
  ("root fsolve stationarypoint criticalpoint singularpoint fixedpoint equilibria equilibrium "
   "steadyline steadystate fixedpoints", "equilibria", "suslov_fast.equilibria(system, near=x0)"),
  ("frominertia frommatrix fromtensor", "from_inertia from_mass_tensor",
   "Field(lambda x: A @ x, len(A))"),
  ("hamiltonian", "energy", "Field.from_hamiltonian"),
  ("exact", "exact", "iterate or flow; bodies have body.exact(omega0, eps, n)"),
  ("modifiedhamiltonian modifiedenergy", "modified_energy",
   "kahan.modified_energy(system, x, eps), or suslov_fast.integrability.report(field).integrals"),
  ("momenta residual projected project constraintforce", "mechanics",
   "field.mechanics of a field from Field.from_lagrangian: momenta, residuals, multipliers, "
   "reactions, projected"),
  ("torque multiplier reaction criticality xy toxy", "reaction mechanics",
   "a method of a body, as body.reaction(omega, eps), body.criticality(omega, eps), body.to_xy"),
  ("restrict levelset", "on_level",
   "suslov_fast.integrability.on_level(map, [integral])"),
  ("hk hirotakimurabasis rankofintegrals", "hk_bases",
   "suslov_fast.integrability.hk_bases(kahan(field), degree)"),
  ("orientation", "attitude", "iterate(..., attitude=True)"),
  ("rotation rotationmatrix", "",
   "iterate(..., attitude=True), or body.momentum(omega) @ body.rotation, in a tensor's basis"),
  ("gyrostat rotor suslovgyrostat suslovrotor", "k", "Suslov3D(I1, I2, I13, I23, k)"),
  ("a", "matrix", "from_inertia(I, a), or from_mass_tensor(I, a) in n dimensions"),
  ("fromsympy fromexpressions", "",
   "Field(sympy.lambdify([symbols, *parameters], expressions), names, a=1.0)"),
  ("fromstring fromtext fromequations fromsecondorder", "from_equations",
   "Field(lambda x, k: (x[1], -k * x[0]), 'q p', k=1.0)"),
  ("darboux darbouxpolynomial", "polynomials darboux_polynomials", ""),
  ("report integral firstintegral invariant conserved conservationlaw conservedquantities "
   "isconserved checkintegral symmetries reversingsymmetries reversors", "integrals",
   "suslov_fast.integrability.report(field)"),
  ("fromarray fromcoefficient frommatrices", "", "Field.from_terms(quadratic, linear, constant)"),
  ("map kahanmap hirotakimura discretize discretization formula", "",
   "suslov_fast.step(system, x, eps), or suslov_fast.integrability.kahan(field).formulas; a map "
   "of one's own is suslov_fast.Map(f, names)"),
  ("discretedynamicalsystem deterministiciteratedmap discretemap difference differenceequation "
   "recurrence henon henonmap logistic logisticmap standardmap qrt qrtmap lyness mcmillan ikeda "
   "tentmap catmap lozi rationalmap", "",
   "suslov_fast.Map(f, names), and iterate(map, x0, steps=n)"),
  ("zoo example dataset kepler duffing pendulum lorenz rossler roessler lotkavolterra vanderpol "
   "henonheiles toda eulertop", "",
   "Field(f, names), or field, eps = suslov_fast.integrability.zoo()[name]"),
  ("entropy algebraicentropy degreegrowth degreesofiterates singularities confinement "
   "singularityconfinement", "proved_entropy",
   "suslov_fast.integrability.planar_entropy(kahan(field)), or growth(degrees(map, 6))"),
  ("invariantmeasure measure density densities", "measures",
   "kahan.invariant_density(system, x, eps), or suslov_fast.integrability.report(field).measures"),
)  # fmt: skip
# Rows whose advice is only for functions and objects with an argument or attribute `steps`, `time`.
OF_STEPS = (
  ("eps epsilon", "eps", "iterate(system, x0, eps, steps), along the map; flow has rtol="),
  ("firststep initialstep", "eps",
   "nothing: flow chooses its first step by rtol=; max_step= bounds all steps"),
  ("dt h step stepsize deltat", "eps",
   "time=np.arange(0, T, dt), at which states are wanted; steps follow from rtol="),
  ("t time teval tend tmax tf tfinal duration", "time period times",
   "flow(system, x0, time=t); along a map iterate(..., steps=n)"),
  ("tspan", "",
   "time=np.linspace(0, T, n) of flow, counted from x0; iterate runs to eps * steps"),
  ("tol rtol reltol accuracy precision", "rtol",
   "flow(..., rtol=); steps of a map have no tolerance"),
  ("atol abstol", "atol", "flow(..., atol=); steps of a map have no tolerance"),
  ("odeset opts options", "rtol", "flow(system, x0, time=t, rtol=, atol=, max_step=)"),
  ("order integrator solver alg algorithm scheme method", "method",
   "nothing: flow chooses its method at each step, by rtol=; stiff=True takes the implicit one "
   "always; field.conserving() keeps the energy, as symplectic methods nearly do"),
  ("toxarray", "to_dataframe", "to_dataframe().to_xarray()"),
  ("maxsteps maxiter maxnumsteps mxstep", "",
   "nothing: no count ends a solution that moves on; progress= ends calls"),
  ("n num nsteps numsteps iterations steps samples size",
   "steps trajectories n J",
   "time=np.linspace(0, T, n) for n times; flow chooses its steps by rtol="),
  ("denseoutput interp interpolate interpolant resample at sol deval", "",
   "motion(t), the solution at any times, with motion = flow(system, x0, time=T); for a table "
   "np.interp(t, times, values) in f"),
  ("nfev njev nlu nstep naccepted fulloutput infodict stats display", "steps",
   "the result, which has steps, status and ok"),
  ("jac jacsparsity lband uband jacobian jacoptions jpattern", "jacobian",
   "stiff=True, for which flow finds the Jacobian itself; its values are field.jacobian(x)"),
  ("every stride thin sample saveat saveeverystep saveall refine", "save_every",
   "time=np.arange(0, T, dt), at which states are wanted"),
)  # fmt: skip
OF_CLOSED_FORMS = "flow(body, omega0, time=t), which is exact; n counts steps of the map"
# How to write in f a function of t that is values[i] from knots[i] to knots[i + 1].
STEPS = "np.interp(t, np.repeat(knots, 2)[1:], np.repeat(values, 2)[:-1])"
# Functions that f of a `Field` or `Map` cannot call, and how to write them with those it can.
OF_ARRAYS = {
    **dict.fromkeys(("sort", "median", "argmax"), "np.minimum, np.maximum, np.where"),
    **dict.fromkeys(
        ("searchsorted", "digitize", "astype"), f"{STEPS} for values[k] from knots[k] on"
    ),
}


_ROWS = {
    word: (names.split(), how, table is OF_STEPS)
    for table in (TABLE, OF_STEPS)
    for words, names, how in table
    for word in words.split()
}


def answer(word: str, known: Collection[str] = ()) -> str:
    """Return the name to use for a word, or the nearest known name; "" if there is none."""
    plain = word.lower().replace("_", "")
    row = _ROWS.get(plain) or _ROWS.get(plain.removesuffix("s"), ([], "", False))
    names, how, is_of_steps = row
    for name in names:
        if name.partition("[")[0] in known:
            return name
    if is_of_steps and not {"time", "steps"} & {*known}:
        return OF_CLOSED_FORMS if "time" in names and {"eps", "n"} <= {*known} else ""
    near = get_close_matches(plain, known, 1, 0.75)
    return near[0] if near and not how else how
