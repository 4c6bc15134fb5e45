"""Numbers that decide about reports: limits of sizes and of tries, rounding."""

# --------------------------------------------------------------------------------------- arithmetic
EXTRA_EQUATIONS = 10  # systems have so many more equations than unknowns
MOST_PRIMES_DRAWN = 8  # primes that are tried until two of them give the same result
# Floats that stand for decimals such as 0.1 have larger denominators.
LEAST_DENOMINATOR_OF_DECIMAL = 2**20
LEAST_WHOLE_FLOAT = 2**53  # all floats above this number are integers
MOST_DENOMINATOR_OF_RATIO = 1000  # ratios of users, such as 8/3, have smaller denominators

# -------------------------------------------------------------------------------------- base_points
MOST_CHANGES_OF_COORDINATES = 20  # the most changes of coordinates that are tried
MOST_POINTS_NEAR_A_POINT = 40  # the most points infinitely near to one point
MEMBERS_COMPARED = 6  # members of which tangents at a point are compared

# ---------------------------------------------------------------------------------- birational_maps
# The most terms of a polynomial that is factored, which takes some 5 s.
MOST_TERMS_FACTORED = 100_000
# The most terms of a polynomial in several letters that is factored.
MOST_TERMS_FACTORED_IN_LETTERS = 3_000
LONGEST_PULLBACK = 6.0  # the most seconds of a pullback, as estimated; longer ones are not computed
# Monomials times degree of a map, above which the image of a line takes longer: `length`.
FEW_MONOMIALS = 100

# -------------------------------------------------------------------------------- contracted_curves
MOST_LINES_TO_A_POINT = 20  # the most random lines on which a point of a curve is sought
# Longer equations of conjugate curves with several letters are not followed.
MOST_TERMS_OF_CURVES = 40
MOST_PRIMES_THAT_AGREE = 80  # the most primes that are tried until two of them agree
BITS_OF_PRIMES = 31  # bits of primes: python-flint 0.9 cannot sort factors with larger coefficients
# Steps in which orders of endless orbits must repeat, after a transient, with a period up to these.
STEPS_OF_REPEATED_ORDERS = 36
LONGEST_TRANSIENT, LONGEST_PERIOD_OF_ORDERS = 8, 12
# A proof gives up if a number in the coordinates of a point has more bits, or if all coordinates of
# a point have more monomials together.
MOST_BITS_OF_PROOF, MOST_MONOMIALS_OF_PROOF = 20_000, 2_000
POINTS_SHOWN = 3  # the number of points that are shown of an orbit that is not confined
MOST_TERMS_OF_POINT = 60  # the most terms in the coordinates of a point that is shown

# ------------------------------------------------------------------------------ degrees_of_iterates
# Expected degree of an iterate times `map.length`, above which it takes over 10 s.
LONGEST_DEGREE = 200_000
# The least number of degrees that confirm a recurrence, besides those that determine it.
SPARE_DEGREES = 3
ROUNDING_OF_ROOT = 1e-9  # relative rounding error of the modulus of a root
# Without a recurrence the last quotients d_(k+1) / d_k decide: growth is called exponential if all
# are above the second number, and the largest is at most the third one times the least.
LAST_QUOTIENTS, LEAST_EXPONENTIAL_QUOTIENT, RATIO_OF_QUOTIENTS = 3, 1.5, 1.1
# Degrees in the plane grow at most as this power of n, or exponentially.
HIGHEST_POWER_IN_THE_PLANE = 2

# ------------------------------------------------------------------------------------------ entropy
MOST_STEPS_OF_CURVE = 80  # the most steps of the orbit of a contracted curve
DEGREES_PREDICTED = 24  # number of degrees of iterates that are predicted
# The largest predicted degree that is compared with the degree on random lines.
HIGHEST_DEGREE_COMPARED = 1_000
TRIES_OF_SMALL_PRIME = 3  # number of points, and of values of letters, for each small prime

# --------------------------------------------------------------------------------------- exact_maps
POINTS_OF_INVERSE = 3  # number of points at which an inverse is checked

# ------------------------------------------------------------------------------------ hirota_kimura
MOST_MONOMIALS_OF_RELATIONS = 500  # largest number of monomials in relations along orbits

# ------------------------------------------------------------------------------------ interpolation
# The largest sum of the degrees of numerator and denominator in several letters.
LARGEST_DEGREE_IN_LETTERS = 64
LARGEST_DEGREE_IN_ONE_LETTER = 256  # the same in one letter
# The most lines s + z t in interpolation; T terms of a degree need 2 T + 1.
MOST_LINES_OF_INTERPOLATION = 1024
MOST_SEARCHES = 4096  # the most calls of a `Search` modulo one prime
# The most primes: enough for numerators and denominators of 1000 decimal digits.
MOST_PRIMES_OF_INTERPOLATION = 128

# ------------------------------------------------------------------------- integrals_of_polynomials
# Larger prime factors of constants are not sought: any coprime factors would do.
LARGEST_PRIME_FACTOR = 2**16
# Weight of equations in a lattice: large, so that short vectors satisfy them.
WEIGHT_OF_EQUATIONS = 2**40
# The largest degree of functions for which limits for eps to 0 are computed.
HIGHEST_DEGREE_OF_LIMITS = 8
# The most letters in a pencil whose reducible members are sought: more take long.
MOST_LETTERS_OF_PENCIL = 6
MOST_PRODUCTS = 20_000  # the most products of generators; others are left out
POINTS_OF_SIGNS = 70  # random points at which `is_definite` compares the signs of a polynomial

# --------------------------------------------------------------------------------------- kahan_maps
# The most variables of a field for which a Hamiltonian is sought.
MOST_VARIABLES_OF_HAMILTONIAN = 10

# ------------------------------------------------------------------------------------------- levels
WIDTH_OF_LEVEL = 60  # the most characters of a polynomial in the text

# --------------------------------------------------------------------------------- linear_relations
ORBITS_OF_RELATIONS = 3  # random orbits; their relations together span the relations of every orbit
# Random orders of the monomials; each gives circuits, minimal dependent sets.
ORDERS_OF_MONOMIALS = 200
# The most quotients c_i / c_j, in all circuits, of which degrees are computed.
MOST_QUOTIENTS = 4_000
MOST_TERMS_WRITTEN = 300  # the most terms of a formula that is written out

# ------------------------------------------------------------------------------------------ pencils
HIGHEST_PENCIL = 6  # the largest degree of a pencil of which reducible members are sought

# ------------------------------------------------------------------------------------------ repairs
CHECKS_OF_CANDIDATE = 2  # random letters at which a candidate must hold
TRIES_OF_CHECK = 40  # random letters that are tried for a check
MOST_MONOMIALS_OF_POINT = 20_000  # the most monomials in the coordinates of a point
# The most monomials of values with the root r of which norms are computed.
MOST_MONOMIALS_OF_NORMS = 300
# The most monomials of polynomials of which resultants are computed.
MOST_MONOMIALS_OF_RESULTANTS = 400

# ------------------------------------------------------------------------------------------- report
# Characters; of a longer polynomial a report shows the degree and number of terms.
WIDTH_OF_REPORT = 150
# Two values of the entropy that differ by at most this are equal up to rounding.
ROUNDING_OF_ENTROPY = 1e-12
# `progress=True` prints a line after 64, 128, 256, ... sets of values of the letters.
SETS_OF_FIRST_LINE = 64

# ------------------------------------------------------------------------------------------- search
# Polynomials above the `degree` of the report, or to shorten integrals that have no more than this
# degree, are sought only if they have at most so many coefficients.
MOST_COEFFICIENTS_OF_OTHERS = 80
ENOUGH_ITERATES = 10  # so many iterates are enough if their degrees satisfy a recurrence
MOST_ITERATES = 40  # the most iterates for which degrees are computed
# While degrees are at most this, iterates beyond ENOUGH_ITERATES follow: they are cheap.
DEGREE_OF_CHEAP_ITERATES = 100
# Expected degree times `map.length`, above which known growth ends the iterates.
COST_OF_KNOWN_GROWTH = 3_000
COST_OF_ITERATES = 8_000  # iterates of a higher expected degree are not computed
# If the latest degree times `map.length` is larger, no iterate follows; at this value the next one
# takes 1 to 4 s (maps of `zoo`, AMD EPYC).
COST_OF_LATEST_DEGREE = 6_000
# The most seconds, as estimated, of a proof that runs before det DPhi is factored.
LONGEST_PROOF_BEFORE_FACTORS = 1.0
# Degree of maps, up to which contracted curves are followed: for 18 it takes minutes.
HIGHEST_MAP_OF_CURVES = 8

# --------------------------------------------------------------------------------------- symmetries
# The largest dimension in which b of S x + b is sought; in three dimensions b = 0.
MOST_DIMENSIONS_OF_SHIFT = 2
MOST_DIMENSIONS_OF_PERMUTATIONS = 6  # the largest dimension in which signed permutations are tried
# All numerators and denominators of entries of S and b must be smaller.
LARGEST_ENTRY_OF_SYMMETRY = 10**6
