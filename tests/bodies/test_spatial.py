"""Angular velocities and momenta as vectors and matrices, in the body and in space."""

import numpy as np

import suslov_fast as sf


def inertia(rng, n=3):
    """Tensors of a few point masses: inertia, and second moments."""
    points = rng.normal(size=(6, n))
    return (points**2).sum() * np.eye(n) - points.T @ points, points.T @ points


def test_momentum_by_definition(rng):
    tensor, _ = inertia(rng)
    axis = rng.normal(size=3)
    body = sf.Suslov3D.from_inertia(tensor, axis)
    rotation = body.rotation
    omega = np.cross(axis, rng.normal(size=3))
    state = (rotation @ omega)[:2]
    np.testing.assert_allclose(rotation[:2].T @ state, omega, atol=1e-14)
    # The component along the axis does not need I3, since Omega3 = 0.
    M = rotation.T @ body.momentum(state)
    np.testing.assert_allclose(M, tensor @ omega, atol=1e-12)
    np.testing.assert_allclose(body.energy(state), 0.5 * omega @ tensor @ omega, rtol=1e-13)
    for n in (2, 3, 5):
        _, mass = inertia(rng, n)
        axis = rng.normal(size=n)
        axis /= np.linalg.norm(axis)
        body = sf.SuslovND.from_mass_tensor(mass, axis)
        rotation = body.rotation
        v = rng.normal(size=n)
        Omega = np.outer(v, axis) - np.outer(axis, v)
        state = (rotation @ Omega @ rotation.T)[:-1, -1]
        M = mass @ Omega + Omega @ mass
        in_body = rotation @ M @ rotation.T
        np.testing.assert_allclose(body.momentum(state), in_body, atol=1e-12)
        np.testing.assert_allclose(body.energy(state), -np.trace(M @ Omega) / 4, rtol=1e-12)


def test_in_space(case):
    body, omega0 = case
    run = sf.iterate(body, [omega0, np.negative(omega0)], 0.1, 20, attitude=True)
    R = run.attitude
    Rt = R.swapaxes(-2, -1)
    vector = len(omega0) == 2
    v = body.momentum(run.states)
    expected = (R @ v[..., None])[..., 0] if vector else R @ v @ Rt
    np.testing.assert_allclose(body.momentum(run.states, attitude=R), expected, atol=1e-13)
