"""The records of the maps of the package."""

from ..bodies.fields.field import Field
from ..bodies.nd import SuslovND
from ..bodies.rigid import Suslov3D, SuslovGyrostat
from .base import MAPS, Map
from .formulas import (
    GYROSTAT,
    IN_3D,
    IN_ND,
    KAHAN,
    OF_ORDER,
    as_it_is,
    eigenvalues_in_3d,
    eigenvalues_nd,
    eigenvalues_of_gyrostat,
    in_plane,
)
from .methods import (
    COMPOSITIONS,
    FIELD,
    STEPS_3D,
    STEPS_ND,
    STEPS_WITH_ROTOR,
    field_in,
)

for _record in (
    Map(  # equation (4) of the paper
        name="Suslov3D",
        title="Discrete Suslov problem",
        body=Suslov3D,
        methods={"auto": STEPS_3D},
        formulas=IN_3D,
        attitude="axial",
        plane=as_it_is,
        eigenvalues=eigenvalues_in_3d,
    ),
    Map(  # equation (15)
        name="SuslovND",
        title="Discrete Suslov problem in n dimensions",
        body=SuslovND,
        methods={"auto": STEPS_ND, "gauss": FIELD},
        formulas=IN_ND,
        attitude="in_rows",
        plane=in_plane,
        eigenvalues=eigenvalues_nd,
    ),
    Map(
        name="SuslovGyrostat",
        title="Discrete Suslov gyrostat",
        body=SuslovGyrostat,
        methods={"auto": STEPS_WITH_ROTOR},
        formulas=GYROSTAT,
        attitude="axial",
        plane=as_it_is,
        eigenvalues=eigenvalues_of_gyrostat,
    ),
    Map(
        name="Kahan",
        title="Kahan map of a quadratic field",
        body=Field,
        methods={"auto": FIELD, "order2": FIELD},
        formulas=KAHAN,
    ),
    *(
        Map(
            name=f"Kahan, order {order}",
            title=f"Composition of Kahan maps, order {order}",
            body=Field,
            methods={f"order{order}": field_in(COMPOSITIONS[order])},
            formulas=OF_ORDER,
            stages=COMPOSITIONS[order],
        )
        for order in COMPOSITIONS
    ),
):
    MAPS[_record.name] = _record
