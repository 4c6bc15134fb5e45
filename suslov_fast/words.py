"""Words of other packages and what is used in their place here: one table, and what answers."""

import re
from collections.abc import Collection, Sequence
from difflib import get_close_matches
from itertools import combinations
from typing import Any

# For each place where words are looked up, rows of words, which are compared without underscores
# and capitals; of names here, of which a function or an object may have one, such as `states` for
# states[0]; and of what to use where it has none.
TABLE = {
  "argument": (
    ("x0 y0 u0 z0 omega0 ic start initial initialstate initialcondition", "states[0] state omega0",
     "the second argument, without a name, for states"),
    ("omega x state states", "states state components omega0",
     "the second argument, without a name, for states"),
    ("body system field fun rhs model", "body vector_field", "the first argument, without a name"),
    ("f", "first_integral body", "the first argument, without a name"),
    ("u", "", "np.interp(t, times, values) in f, with a variable t of the rate 1"),
    ("store path filename file save savepath zarr disk", "store path",
     "run.save(path), or ensemble(..., store=path) for more than fits into memory"),
  ),
  "flow": (
    ("dtmax hmax longeststep", "max_step", ""),
    ("nonnegative positive", "", "atol=0, for which small components have digits of their own"),
    ("transient burnin skip discard", "", "time=np.linspace(transient, T, n)"),
    ("order integrator solver alg algorithm scheme method", "",
     "stiff=True if at all: flow chooses methods, and steps by rtol="),
    ("symplectic conserve project", "",
     "iterate(field, x0, eps, steps), a map that conserves energies of a QuadraticField"),
    ("finalonly last final", "", "time=T, one time"),
    ("teval", "", "time= with all times, as time=np.linspace(0, T, 500): two are two times"),
    ("attitude orientation rotation", "",
     "iterate(body, x0, eps, steps, attitude=True), of the map: flow computes none"),
  ),
  "iterate crossings ensemble lyapunov_exponents step jacobian": (
    ("order", "", "method='order4', 'order6' or 'order8'; without it the order is 2"),
  ),
  "iterate": (
    ("transient burnin skip discard", "", "run.states[k:], of k steps, or crossings(transient=k)"),
    ("finalonly last final returnall", "", "save_every=None, which keeps the last states alone"),
    ("symplectic", "method", ""),
    ("derivatives derivative jacobian variational", "",
     "suslov_fast.jacobian(system, run.states[:-1], eps), of each step"),
  ),
  "crossings": (
    ("g plane component names", "surface", ""),
    ("value level threshold", "", "the difference as the surface, as surface='x - 1'"),
    ("sign dir up down both rising falling", "direction", ""),
    ("limit nmax max maxn maxcount", "most", ""),
    ("count n", "", "most= for a number of crossings, beside time=T, or eps= and steps="),
    ("skip", "transient", ""),
    ("change", "", "flow(system, x0, time=t, changes=[Change(g), ...]), in which g alone records"),
  ),
  "plot": (
    ("x y z components", "", "the names of components alone, as run.plot('x', 'y')"),
    ("save savefig path filename file", "", "plot().figure.savefig(path)"),
    ("fig axes axis size title log", "ax", ""),
    ("s marker style linestyle ls lw linewidth alpha cmap", "",
     "ax.plot(run['name'], run['other'], ...) of Matplotlib"),
    ("show", "", "plt.show()"),
  ),
  "save": (
    ("force mode replace", "overwrite", ""),
    ("fname name", "path", ""),
  ),
  "degrees hk_bases cofactors darboux_polynomials planar_entropy on_level": (
    ("eps h step", "", "kahan(field, eps) as the map"),
  ),
  "hk_bases": (
    ("degree deg d maxdegree", "monomials", ""),
  ),
  "degrees": (
    ("nmax steps iterations count", "n", ""),
  ),
  "kahan": (
    ("step", "eps", ""),
  ),
  "exact": (
    ("k step", "n", ""),
  ),
  "RandomStarts": (
    ("n num number samples", "size", ""),
    ("range bounds min max lower upper", "", "low= and high=, or extent= for both"),
    ("scale sigma std radius width", "extent", ""),
    ("dim dimension d", "", "size alone: the system says how many components there are"),
  ),
  "Suslov3D": (
    ("n dim dimension", "dimension", "SuslovND(J, I)"),
    ("j", "", "SuslovND(J, I)"),
    ("k axis", "", "SuslovGyrostat(I1, I2, I13, I23, k), with a rotor along the constrained axis"),
  ),
  "jacobian": (
    ("eps dt h stepsize", "eps", "suslov_fast.jacobian(system, x, eps), of a step; this is f'(x)"),
  ),
  "crossings ensemble lyapunov_exponents explore": (
    ("dt h stepsize deltat", "",
     "eps= and steps= for the map, counted in steps, or time=T for the motion, in time"),
  ),
  "lyapunov_exponents": (
    ("n k num count numexponents nexponents largest", "",
     "[..., 0] of the result, which has all exponents; steps= is for a map"),
    ("burn warmup skip discard", "transient", ""),
    ("history convergence returnhistory", "", "several calls, of times T, 2 T and 4 T"),
  ),
  "ensemble": (
    ("n nsteps numsteps iterations maxsteps maxiter samples size", "",
     "steps= for the map, or RandomStarts(n, extent) as x0 for n trajectories"),
  ),
  "periodic_orbit": (
    ("dt h stepsize deltat", "eps", ""),
    ("n nsteps iterations multiplicity", "steps", ""),
    ("maxiter maxiterations", "", "a nearer start: Newton's steps end by themselves"),
    ("energy level integral", "", "a start on that level: the orbit of a family near it is found"),
    ("guess", "", "the second argument, without a name, and period="),
    ("section surface plane", "", "a start and period= alone: no section is needed"),
  ),
  "fixed_points": (
    ("x0 y0 guess start initial initialguess", "near", ""),
    ("region bounds box grid n seed range all", "",
     "near= with a grid of states (..., D), and np.unique of its states, rounded, on axis 0"),
    ("tol maxiter method", "", "near= alone: Newton's method goes on to rounding errors"),
    ("eps steps", "", "near= alone: maps have the same ones, and multipliers(system, x, eps)"),
  ),
  "report": (
    ("dt h step stepsize deltat", "eps", ""),
    ("order deg d n maxdegree", "degree", ""),
    ("integral measure entropy", "", "the attributes of the report: integrals, measures, growth"),
  ),
  "Change": (
    ("time t at when", "times", ""),
    ("period every repeat", "", "times=np.arange(T, last, T)"),
    ("map new jump", "to", ""),
    ("guard g", "surface", ""),
    ("parameter param p set", "",
     "to=, and a variable of the rate 0 in place of a parameter that changes"),
    ("sign dir", "direction", ""),
    ("n count maxcount", "most", ""),
  ),
  # Attributes of systems.
  "Body": (
    ("omega omega0 state states x x0", "",
     "iterate(system, x0, eps, steps) or flow(system, x0, time=t), which take states"),
    ("copy deepcopy", "", "the system itself, which never changes"),
  ),
  "plot_phase": (
    ("states x0 omega0 starts start initial steps time t n samples orbits method", "",
     "iterate(body, states, eps, steps).plot(), because extent= and levels= choose orbits here"),
    ("xlim ylim range size lim limits box", "extent", ""),
    ("num lines", "levels", ""),
    ("color cmap title arrows", "ax", ""),
  ),
  # Formulas of the laboratory.
  "RationalFunction": (
    ("freesymbols atoms args simplify expand together cancel apart diff series evalf numer "
     "denom asnumerdenom coefficient coeff", "",
     "sympy.sympify(F), an expression of SymPy"),
  ),
  # Names of the package.
  "module": (
    ("system model odesystem equation dynamicalsystem dynamics problem", "",
     "Field.from_function(lambda x, a: (x[1], -a * x[0]), 'q p', a=1.0)"),
    ("hamiltonian lagrangian canonical poissonbracket", "",
     "Field.from_hamiltonian(H, names, K=K), with the structure K, or for M(x) x' = f(x) "
     "from_function(f, names, mass=M)"),
    ("leapfrog verlet symplectic euler rk4 midpoint yoshida", "",
     "iterate(system, x0, eps, steps) by Kahan's method, or flow(system, x0, time=t)"),
    ("batch vmap parallel", "", "flow(field, x0, time=t), of arrays of states and of parameters"),
    ("montecarlo sample random", "RandomStarts", ""),
    ("save load read write export fromfile open", "", "run.save(path), and load(path)"),
    ("frominertia frommatrix frommasstensor inertia inertiamatrix tensor", "",
     "body, rotation = Suslov3D.from_inertia(I, a), or SuslovND.from_mass_tensor(I)"),
    ("lsim stepresponse impulseresponse", "", "scipy.signal, with A = field.jacobian(x)"),
    ("periodic cycle closedorbit", "periodic_orbit", ""),
    ("floquet floquetmultiplier", "", "periodic_orbit(system, x0).multipliers"),
    ("body rigidbody suslov suslovproblem", "",
     "Suslov3D(I1, I2, I13, I23), SuslovND(J, I), or with a rotor SuslovGyrostat"),
    ("version info doctor config", "show_versions", ""),
    ("levelset energysurface isoline", "",
     "plt.contour of Matplotlib, of suslov_fast.energy(system, grid), or plot_phase(body)"),
    ("grid meshgrid linspace uniform", "",
     "an array of states (..., D), as np.stack(np.meshgrid(x, y), axis=-1)"),
    ("periodicpoint ncycle", "",
     "suslov_fast.periodic_orbit(system, x0, eps=eps, steps=n), of a map"),
    ("qrt qrtmap birational birationalmap rational henonmap", "",
     "suslov_fast.integrability.rational_map(f, dimension), of f that maps a state to the next"),
  ),
  "from_inertia from_mass_tensor": (
    ("axis normal direction vector n", "a", ""),
  ),
  "from_hamiltonian": (
    ("poisson j structure bracket omega symplectic poissonmatrix poissontensor", "K", ""),
  ),
  "Suslov3D SuslovGyrostat SuslovND": (
    ("equation formula latex", "", "str(body.field()), or sympy.latex(body)"),
  ),
  "Suslov3D SuslovND": (
    ("steadystate steadyline equilibria equilibrium fixedpoint", "",
     "suslov_fast.fixed_points(system, near=x0): the steady states are a line through 0"),
  ),
  "FieldOfFunction": (
    ("f rhs righthandside", "", "field(x)"),
    ("expression string text", "", "str(field)"),
  ),
  "PeriodicOrbit": (
    ("eigenvalues eig stable isstable stability", "",
     "multipliers: it is stable if, but for one that is 1, their moduli are below 1"),
    ("states x points", "state", ""),
    ("trajectory orbit plot run", "",
     "flow(system, orbit.state, time=np.linspace(0, orbit.period, 201)), and its plot()"),
    ("error residuals", "residual", ""),
  ),
  "RationalMap": (
    ("formula expression equation component latex sympy", "formulas", ""),
    ("numerator denominator", "forms", ""),
    ("det detjacobian", "determinant", ""),
    ("iterate step orbit next", "", "x = map(x), in a loop"),
    ("invariant integral firstintegral", "", "suslov_fast.integrability.report(field).integrals"),
    ("degree growth", "", "suslov_fast.integrability.degrees(map, 8)"),
  ),
  "HKBasis": (
    ("bases formula invariant", "integrals", ""),
  ),
  "Report": (
    ("formula invariant text conserved", "integrals", ""),
    ("latex tex tolatex sympy", "", "sympy.latex(F), or sympy.sympify(F), of F in integrals"),
    ("integrable isintegrable", "", "integrals, dimension, of their levels, and growth"),
    ("degreesequence sequence", "degrees", ""),
    ("cofactor darboux", "polynomials", ""),
  ),
  "Equilibria": (
    ("stable isstable stability type", "", "eigenvalues.real.max(axis=-1) < 0, where true"),
    ("x state points", "states", ""),
    ("eig", "eigenvalues", ""),
  ),
  # Attributes of results.
  "Result": (
    ("t", "time", ""),
    ("H", "", "energy()"),
    ("integral firstintegral invariant", "first_integral", ""),
    ("amplitude maximum minimum", "",
     "crossings(field, x0, time=T, surface=lambda x: -field(x)[..., 0]), of its maxima"),
    ("message", "", "[suslov_fast.Status(k).message for k in run.status.flat]"),
    ("endtime stoptime stoppedat", "end", ""),
    ("array asarray tolist", "states", ""),
    ("fft psd powerspectrum spectrum autocorrelation", "",
     "np.fft.rfft(run['...']) of a component at equal times, or scipy.signal.welch"),
    ("pole poles singular firstfailure", "first_pole", "status and end"),
    ("length len size", "", "len(run), and run.states.shape"),
    ("orientation attitude", "", "attitude of iterate(..., attitude=True); flow has none"),
    ("parameters params", "", "run.body.parameters"),
    ("statistics stats info", "", "steps, status and ok"),
    ("count nevents", "count", "changes.count, of a motion with changes="),
    ("tevents yevents event", "",
     "changes of a motion with changes=, or crossings(system, x0, time=T, surface=...)"),
    ("field system", "body", ""),
    ("stopped", "", "ok, status and end"),
    ("df dataframe to_df to_pandas", "to_dataframe", ""),
    ("to_csv csv export output to_excel", "",
     "to_dataframe().to_csv(path, index=False), or to_excel"),
  ),
  "Motion": (
    ("endstate stateatend finalevent eventstate", "",
     "changes.states, of a motion that a change ends: later states are NaN"),
    ("jacobian sensitivity sensitivities gradient tangent variational", "",
     "derivative('x0') of flow(..., derivatives=('x0', 'a'))"),
  ),
  "Points": (
    ("trajectories orbit index member id", "trajectory", ""),
    ("which surface", "surface which", ""),
    ("hits number ncrossings nhits", "count", ""),
    ("split group groupby bytrajectory pertrajectory of", "",
     "[points.states[points.trajectory == k] for k in range(points.count.size)]"),
    ("period interval diff returntime isi", "",
     "np.diff(points.time[points.trajectory == k]), of trajectory k"),
    ("t_events y_events events times stop_time time_stop first step return_map", "",
     "time and states, of all trajectories: time[trajectory == k] are those of trajectory k"),
  ),
  # Functions of arrays that have no record, and how to write them by those that have one.
  "f": (
    ("sinc", "", "np.where(x == 0, 1, np.sin(np.pi*x)/(np.pi*x)) for np.sinc(x)"),
    ("logaddexp2", "", "np.logaddexp(x*np.log(2), y*np.log(2))/np.log(2) for np.logaddexp2(x, y)"),
    ("fmax", "", "np.maximum"),
    ("fmin", "", "np.minimum"),
    ("rint round around", "", "np.floor(x + 0.5)"),
    ("fmod", "", "x - y*np.trunc(x/y) for np.fmod(x, y)"),
    ("piecewise", "", "np.where"),
    ("isfinite", "", "np.abs(x) < np.inf"),
    ("isnan", "", "x != x"),
    ("nan_to_num", "", "np.where(x == x, x, 0)"),
    ("unwrap", "", "np.arctan2 of the sine and the cosine"),
    ("sort", "", "np.minimum and np.maximum"),
    ("median argmax argmin argsort", "", "np.minimum, np.maximum, np.where"),
    ("count_nonzero", "", "(x > 0).sum()"),
    ("searchsorted digitize", "", "np.where(x < knot, a, b)"),
    ("gradient", "", "(np.roll(x, -1) - np.roll(x, 1))/2, or np.diff(x)"),
    ("fft ifft rfft irfft", "", "a product with a matrix of numbers"),
    ("solve det inv", "",
     "mass=M of Field.from_function for M(x) x' = f(x), or np.linalg.inv(M) @ b with numbers in M"),
  ),
  # Public functions, and what to use for a system that has none of its own.
  "map": (
    ("exact", "", "iterate or flow, because it has no closed form"),
    ("flow limits", "", "iterate, because it has no closed form"),
    ("closed_form", "", "exact, or iterate where there is no closed form"),
    ("matrix", "", "jacobian, because its step is not the solution of one linear system"),
    ("first_integral", "", "suslov_fast.integrability.report, which looks for integrals"),
    ("criticality", "", "run.status and run.first_pole, which tell of steps that are too long"),
    ("momentum reaction to_matrix", "", "a body, because these states rotate none"),
    ("rotation_number", "", "np.unwrap(np.arctan2(x[:, 1], x[:, 0])) / (2 * np.pi) of a run x"),
    ("to_vector", "", "to_matrix, which has n dimensions"),
    ("explore plot_phase", "", "iterate(...).plot() or flow(...).plot()"),
    ("step_full", "", "step, iterate or flow"),
    ("scattering_angle", "", "iterate(..., attitude=True) where states have an orientation"),
  ),
  # The same for bodies in n dimensions for which no formula is known.
  "no_formula": (
    ("exact limits", "", "iterate"),
    ("flow", "", "flow, which computes it to a tolerance"),
    ("first_integral", "", "suslov_fast.integrability.report, which looks for integrals"),
    ("criticality", "", "iterate, and compare with half the step size"),
    ("invariant_density", "", "the determinant of jacobian"),
  ),
  # What is passed in place of a system.
  "system": (
    ("class", "", "pass an object of the class"),
    ("function", "", "pass QuadraticField.from_function(f, names), of the ODE x' = f(x): "
     "a map x -> f(x) of your own is a loop"),
    ("tuple", "", "pass its first item: figure returns eps, from_inertia and "
     "from_mass_tensor a rotation, too"),
    ("list", "", "pass one, with arrays as parameters"),
    ("SuslovGyrostat", "", "with a rotor use exact, iterate or flow"),
    ("Hamiltonian Energy", "", "pass the field, whose Hamiltonian this is"),
    ("RationalMap", "",
     "pass the field itself; a rational map is only for the functions of integrability"),
    ("Crossings", "",
     "pass its body, run.body; points x turn by np.unwrap(np.arctan2(x[:, 1], x[:, 0]))"),
    ("Result", "", "pass its body, run.body"),
    ("Body", "", ""),
    ("object", "", "pass a body, or a field such as QuadraticField.from_function(f, names)"),
  ),
  # Options and commands.
  "command": (
    ("dt deltat stepsize h", "", "--eps X of the map, or --points N of the motion to --time T"),
    ("system field ode rhs", "equations", ""),
    ("save out file", "output", ""),
    ("p param parameter", "", "--equations \"x' = a*x; a = 2\", with the parameter"),
    ("hamiltonian", "", "--equations \"q' = p; p' = -q\"; from_hamiltonian of Python takes H"),
    ("x0 y0 u0 start state states", "omega0", ""),
    ("flow iterate ensemble solve integrate", "run", ""),
    ("n size samples", "trajectories", ""),
    ("gui serve app browser sliders", "explore", ""),
    ("integrals entropy degrees", "report", ""),
    ("open show load cat print", "info", ""),
    ("phase portrait paper", "figures", ""),
    ("draw", "plot", ""),
  ),
  "words": (
    ("x0 y0 u0 z0 omega0 ic start initial initialstate initialcondition", "states[0] state", ""),
    ("omega x state", "states state components", ""),
    ("body system field fun rhs model", "body vector_field", ""),
    ("f", "first_integral body", ""),
    ("eps epsilon", "eps", "iterate(system, x0, eps, steps), along the map; flow has rtol="),
    ("dt h stepsize deltat firststep initialstep", "eps",
     "time=np.arange(0, T, dt), at which states are wanted; steps follow from rtol="),
    ("t time teval tend tmax tf tfinal duration", "time period steps",
     "flow(system, x0, time=t), or the steps n of a map"),
    ("tspan t0", "",
     "time=np.linspace(0, T, n) of flow, counted from x0; iterate runs to eps * steps"),
    ("backward reverse inverse", "", "-eps, which undoes a step"),
    ("tol rtol reltol accuracy precision", "rtol",
     "flow(..., rtol=); steps of a map have no tolerance"),
    ("atol abstol", "atol", "flow(..., atol=); steps of a map have no tolerance"),
    ("order integrator solver alg algorithm scheme method", "method",
     "rtol= of flow, which chooses its steps, and stiff or not unless stiff= says; iterate has "
     "method="),
    ("n num nsteps numsteps iterations maxsteps maxiter steps samples size",
     "steps trajectories n J",
     "time=np.linspace(0, T, n) for n times; flow chooses its steps by rtol="),
    ("denseoutput interp interpolate interpolant resample at sol deval", "",
     "flow(system, x0, time=t), at any times t; for a table np.interp(t, times, values) in f"),
    ("nfev njev nlu nstep naccepted fulloutput infodict stats display", "steps",
     "the result, which has steps, status and ok"),
    ("arg p param parameter", "parameters",
     "field.with_parameters(a=1), or make a body again; an array makes a family"),
    ("withparameters setparameters setparams set replace subs update", "with_parameters",
     "a new system, with the new parameters; arrays make a family"),
    ("frequencyresponse sweep parametersweep resonance family vary scan product", "",
     "flow(field.with_parameters(a=array), x0, time=t), all values of a parameter at once"),
    ("fit curvefit leastsquares estimate minimize optimize", "",
     "scipy.optimize.least_squares with flow(field.with_parameters(a=a), x0, time=t)"),
    ("table lookup lookuptable interp1d input control timeseries", "",
     "np.interp(t, times, values) in f, with a variable t of the rate 1"),
    ("jac jacsparsity lband uband jacobian jacoptions jpattern", "jacobian",
     "stiff=True, for which flow finds the Jacobian itself; its values are field.jacobian(x)"),
    ("vectorized vectorize", "", "states (..., D), of which each is a trajectory"),
    ("mass massmatrix m", "", "Field.from_function(f, names, mass=M), for M(x) x' = f(x)"),
    ("delay lag history dde dde23 ddesd", "",
     "a package for delays, such as DelayDiffEq of Julia: here f has the present state alone"),
    ("noise sde sdeint sdeproblem stochastic brownian diffusion", "",
     "a package for noise, such as diffrax: here equations have none"),
    ("bode transferfunction statespace lti ss", "",
     "scipy.signal, with A = field.jacobian(x) of an equilibrium x"),
    ("change", "changes Change",
     "flow(system, x0, time=t, changes=...), lyapunov_exponents, ensemble or periodic_orbit: maps "
     "have none"),
    ("after newstate", "states", ""),
    ("event section condition value trigger", "surface",
     "crossings(system, x0, time=T, surface=lambda x: x[..., 0], direction=0), or "
     "changes=Change(lambda x: x[0], to=lambda x: ...) of flow, where the state changes there, and "
     "ends=True in place of to, where it ends"),
    ("jump dose impulse dosetime tstop schedule bolus infusion presettime discretecallback",
     "times",
     "changes=Change(times=[1, 2], to=lambda x: (x[0] + 1, x[1])) of flow"),
    ("reset bounce bouncing restitution impact contact collision affect effect action spike kick",
     "to",
     "changes=Change(lambda x: x[0], direction=-1, to=lambda x: (x[0], -x[1])) of flow"),
    ("callback cb callbackset continuouscallback outputfcn outputfunction", "",
     "changes=Change(lambda x: x[0], to=lambda x: ...) of flow, where the state changes, or "
     "progress=f, which is told how far a run is"),
    ("poincare poincaremap poincaresection poincaresos tevents yevents te ye xe ie brentq "
     "returnmap",
     "crossings", ""),
    ("maxima peak localmaxima extrema", "",
     "crossings(field, x0, time=T, surface=lambda x: -field(x)[..., 0]), maxima of component 0"),
    ("stroboscopic stroboscope stroboscopicmap", "",
     "flow(field, x0, time=T * np.arange(n)), T the period of the force"),
    ("limitcycle cycle bvp4c solvebvp bvp", "",
     "periodic_orbit(field, flow(field, x0, time=100).x[-1])"),
    ("period frequency", "period", "periodic_orbit(field, x0).period"),
    ("floquet floquetmultipliers", "multipliers", ""),
    ("monodromy variational", "",
     "flow(field, x0, time=T, derivatives='x0').derivative('x0'), of which [-1] is that of T"),
    ("count maxevents maxcrossings", "most", ""),
    ("terminal terminate stop stopwhen until firstpassage escape escapetime exittime firsthit "
     "firstreturn", "ends most",
     "changes=Change(lambda x: x[0], ends=True) of flow, or crossings(system, x0, time=T, "
     "surface=lambda x: x[..., 0], direction=0, most=1)"),
    ("basin basinsofattraction", "", "flow(field, grid, time=T).x[-1], or crossings(..., most=1)"),
    ("burnin ntransient transienttime ttr discard", "transient", ""),
    ("every stride thin sample saveat saveeverystep saveall refine", "save_every",
     "time=np.arange(0, T, dt), at which states are wanted"),
    ("njobs nworkers workers numthreads setnumthreads setthreads threads cores parallel",
     "threads client", "threads= of each function"),
    ("timeout maxtime budget timelimit", "time_limit progress", ""),
    ("verbose tqdm progressbar progress logging", "progress", "progress= of each function"),
    ("seed rng randomstate", "seed RandomStarts", "RandomStarts(size, seed=...) as states"),
    ("out output csv", "out output", "ensemble(..., store=), which writes to disk"),
    ("exact rational fractions", "exact",
     "map = suslov_fast.integrability.kahan(field, eps), and x = map(x), in fractions"),
    ("overwrite mode", "force", "another name, or delete the folder of the store"),
    ("c color colour colors", "color constant", ""),
    ("y z", "components", "states, of the shape (times, ..., D)"),
    ("figsize xlim ylim xlabel ylabel grid legend", "ax", ""),
    *((f"i{k}{k}", f"I{k}", "") for k in (1, 2, 3)),
    *((f"i3{k}", f"I{k}3", "") for k in (1, 2)),
    ("i inertia inertiamatrix tensor i12 i21", "parameters",
     "from_inertia(I, a), or from_mass_tensor(I, a) in n dimensions"),
    ("u values result data trajectories points shape numpy tonumpy select max min mean", "states",
     "iterate, whose result has states"),
    ("solution explicitsolution", "states exact", ""),
    ("k1 k2 closedform", "closed_form", ""),
    ("index idx member which", "trajectory", "states[:, i], of trajectory i"),
    ("success retcode", "ok", ""),
    ("message error failed failedat", "status", ""),
    ("last end final finalstate laststate", "final states[-1]", ""),
    ("resume restart continue extend", "extend",
     "the same call again, which goes on with a store, or its last states as x0"),
    ("tonetcdf tozarr sel isel", "to_xarray", ""),
    ("savefig figure", "figures plot", "plot().figure.savefig(path)"),
    ("save tojson tofile dump", "save", "json.dump(body.to_dict(), file)"),
    ("equation", "body", "str(...), the formula"),
    ("symbolic symbol", "", "eps, which is symbolic if it is left out: all else is numbers"),
    ("latex tolatex tosympy sympify", "",
     "str(...), the formula; of an integral F sympy.sympify(F), and sympy.latex(F)"),
    ("eval evaluate", "", "field(x), the value of the right-hand side"),
    ("lambdify", "compiled", "field(x), or compiled.system in loops of your own"),
    ("dim ndim d", "dimension", ""),
    ("dx derivative linearize", "",
     "field.jacobian(x), of its right-hand side; for a body QuadraticField.of(body).jacobian(x)"),
    ("eig eigenvalues stability stable isstable linearstability", "",
     "np.linalg.eigvals(field.jacobian(x)), or multipliers(system, x, eps), of a map"),
    ("parameterjacobian dfdp inputmatrix", "",
     "(field.with_parameters(a=a + h)(x) - field(x)) / h"),
    ("quadratic linear constant term coefficient", "quadratic",
     "QuadraticField.of(body), whose terms they are"),
    ("variable", "names labels", ""),
    ("solveivp odeint ode integrate solve exactflow ode45 ode15s ode23 ode23s ode113 odeproblem "
     "rk45 dop853 radau bdf lsoda quad", "flow", ""),
    ("odeset opts options", "rtol", "flow(system, x0, time=t, rtol=, atol=, max_step=)"),
    ("flow iterate ensemble", "run", ""),
    ("run", "", "suslov_fast.flow(system, x0, time=t), or suslov_fast.iterate along the map"),
    ("trajectory orbit simulate simulation simulator evolve", "run states",
     "suslov_fast.flow(system, x0, time=t), or suslov_fast.iterate along the map"),
    ("orbitdiagram bifurcationdiagram bifurcation hopf fold saddlenode continuation", "",
     "a family, from_function(f, names, c=array), and c[points.trajectory] of its crossings"),
    ("phaseportrait plotphaseportrait pplane phasespace quiver streamplot", "plot",
     "flow(field, grid, time=t).plot()"),
    ("plot3d", "", "plot(a, b, c), with the names of three components"),
    ("plot fplot", "plot",
     "iterate(...).plot(), or flow(field, x0, time=np.linspace(0, T, 201)).plot()"),
    ("nullcline", "",
     "plt.contour(X, Y, field(np.stack([X, Y], axis=-1))[..., 0], [0]) of Matplotlib"),
    ("sensitivity sensitivities gradient grad adjoint tangent", "",
     "flow(..., derivatives=('x0', 'a')), and derivative('a') of its result"),
    ("lyapunov lyapunovspectrum lyap sali gali megno ftle", "lyapunov_exponents", ""),
    ("kaplanyorke kaplanyorkedimension lyapunovdimension", "",
     "k + L[:k].sum() / abs(L[k]), of exponents L, with k = (np.cumsum(L) >= 0).sum()"),
    ("maxlyapunov largestlyapunov lyapunovexponent", "",
     "suslov_fast.lyapunov_exponents(system, x0, time=T)[..., 0], the largest"),
    ("root fsolve stationarypoint criticalpoint singularpoint fixedpoint equilibria equilibrium "
     "steadyline steadystate", "",
     "suslov_fast.fixed_points(system, near=x0), or those of a quadratic field without near"),
    ("frominertia frommatrix fromtensor", "from_inertia from_mass_tensor",
     "from_function(lambda x: A @ x, len(A))"),
    ("inn iii", "", "J, of J_i = I_ii + I_nn, and I, of I_i = I_in, or from_mass_tensor"),
    ("hamiltonian", "energy", "QuadraticField.from_hamiltonian"),
    ("modifiedhamiltonian", "modified_energy", ""),
    ("plotenergy energydrift energyerror", "", "plot(run.time, run.energy()) of Matplotlib"),
    ("theorem1 theorem", "exact", ""),
    ("lemma1", "first_integral", ""),
    ("xy", "to_xy", ""),
    ("windingnumber winding", "rotation_number", ""),
    ("divergence trace", "", "np.trace(field.jacobian(x), axis1=-2, axis2=-1)"),
    ("separatrix manifold stablemanifold unstablemanifold", "",
     "flow(field, x + h * v, time=T), with an eigenvector v of field.jacobian(x)"),
    ("pde pdepe heat", "",
     "from_function(lambda u: np.roll(u, 1) - 2 * u + np.roll(u, -1), n), on a grid"),
    ("lambda torque multiplier", "reaction multipliers", ""),
    ("orientation rotation rotationmatrix", "attitude", "iterate(..., attitude=True)"),
    ("scattering heteroclinicangle rotationangle turningangle", "scattering_angle", ""),
    ("gyrostat suslovrotor rotor", "k SuslovGyrostat",
     "SuslovGyrostat(I1, I2, I13, I23, k), where k is along the constrained axis"),
    ("suslov", "", "Suslov3D, or Suslov3D.from_inertia(I, a)"),
    ("from3d fromsuslov3d", "", "SuslovND([I2, I1], [-I13, -I23]), for states (Omega2, -Omega1)"),
    ("a", "matrix",
     "from_inertia(I, a), or from_mass_tensor(I, a) in n dimensions"),
    ("residual", "", "matrix(body, x, eps) @ x_next - x, which is 0 along the map"),
    ("fromsympy fromexpressions", "",
     "from_function(sympy.lambdify([symbols, *parameters], expressions), names, a=1.0)"),
    ("fromstring fromtext fromequations fromsecondorder", "",
     "from_function(lambda x, k: (x[1], -k * x[0]), 'q p', k=1.0)"),
    ("fromfunction", "from_function", "QuadraticField.from_function, or Field.from_function"),
    ("figures picture", "figures figure", "plot_phase(*suslov_fast.Suslov3D.figure(k))"),
    ("animate animation animatebody", "",
     "FuncAnimation of Matplotlib, as docs/examples/turning_body.py for a body"),
    ("darboux darbouxpolynomial", "polynomials darboux_polynomials", ""),
    ("fromnambu", "", "from_function(lambda x: ..., names), of the product of two gradients"),
    ("fromsuslov frombody", "", "QuadraticField.of(body)"),
    ("report integral firstintegrals invariant conserved conservedquantities conservationlaw "
     "countintegrals", "integrals",
     "suslov_fast.integrability.report(field)"),
    ("fromarray fromcoefficient frommatrices", "", "QuadraticField(quadratic, linear, constant)"),
    ("map kahanmap hirotakimura discretize discretization formula", "",
     "suslov_fast.step(system, x, eps), or suslov_fast.integrability.kahan(field).formulas"),
    ("zoo example dataset systems henon lyness toda kepler duffing pendulum lorenz roessler "
     "rossler henonheiles lotkavolterra vanderpol eulertop", "",
     "from_function(f, names), or field, eps = suslov_fast.integrability.zoo()[name]"),
    ("kahan rationalmap rationalorbit exactmap", "",
     "map = suslov_fast.integrability.kahan(field, eps), and x = map(x), in fractions"),
    ("algebraicentropy entropy degreegrowth degreesofiterates", "proved_entropy",
     "suslov_fast.integrability.planar_entropy(kahan(field)), or growth(degrees(map, 6))"),
    ("singularityconfinement confinement singularities", "",
     "suslov_fast.integrability.planar_entropy(kahan(field)), whose result has the orbits"),
    ("invariantmeasure measure density", "measures",
     "invariant_density(system, x, eps), or suslov_fast.integrability.report(field).measures"),
    ("hk hirotakimurabasis hkbasis rankofintegrals rank", "hk_bases",
     "suslov_fast.integrability.hk_bases(kahan(field), degree)"),
    ("checkintegral isintegral isconserved verify", "",
     "F(x) == F(map(x)) for fractions x, of map = suslov_fast.integrability.kahan(field, eps)"),
    ("lax laxpair", "", "suslov_fast.integrability.report(field), which finds integrals"),
    ("summary describe", "", "print(...)"),
    ("warmup compile precompile", "warm_up", "the command suslov-fast warm-up"),
  ),
}  # fmt: skip


def _plain(word: str) -> str:
    return word.lower().replace("_", "")


_ROWS = {
    (place, _plain(word)): (names.split(), how)
    for places, rows in TABLE.items()
    for place in places.split()
    for words, names, how in rows
    for word in words.split()
}


def answer(word: str, known: Collection[str], *places: str) -> str:
    """Return what to use for a word in the first place that knows it, or the nearest known name.

    Of a word of several parts, such as solve_ode, that may be what to use for a part.
    """
    alike = {_plain(each): each for each in known}
    if here := _looked_up(_plain(word), known, places) or alike.get(_plain(word), ""):
        return here
    if near := get_close_matches(word, known, 1, 0.75):
        return near[0]
    parts = re.findall("[A-Za-z][a-z]*", word)
    spans = combinations(range(len(parts) + 1), 2)
    joined = sorted(("".join(parts[i:j]) for i, j in spans), key=len, reverse=True)
    answers = (_looked_up(each.lower(), known, places) for each in joined if len(each) > 2)
    return next(filter(None, answers), "")


def _looked_up(plain: str, known: Collection[str], places: Sequence[str]) -> str:
    """Return what to use for a word, or for a part of one, in the first place that knows it."""
    for place in places:
        row = _ROWS.get((place, plain)) or _ROWS.get((place, plain.removesuffix("s")))
        names, how = row or ([], "")
        if found := next((name for name in names if name.partition("[")[0] in known), how):
            return found
    return plain if plain in known else ""


def in_place_of(value: Any, maker: str = "QuadraticField") -> str:
    """Return advice, for messages, on what to pass in place of a value that is no such system."""
    kinds = [kind.__name__ for kind in type(value).__mro__]
    if isinstance(value, type):
        kinds = ["class"]
    elif isinstance(value, (tuple, list)) and not (value and hasattr(value[0], "called")):
        kinds = ["object"]
    if callable(value):
        kinds.insert(-1, "function")
    _, how = next(
        _ROWS["system", _plain(each)] for each in kinds if ("system", _plain(each)) in _ROWS
    )
    return f": {how.replace('QuadraticField', maker)}" if how else ""
