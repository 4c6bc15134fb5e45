"""The records of Kahan's map of fields, of its compositions, and of maps of one's own."""

from ..bodies.fields.field import Field
from ..bodies.fields.map import Map
from .base import MAPS, Discretization
from .formulas import KAHAN
from .methods import COMPOSITIONS, FIELD, OWN_MAP, field_in

for _record in (
    Discretization(
        name="Kahan",
        title="Kahan map of a quadratic field",
        body=Field,
        methods={"auto": FIELD, "order2": FIELD},
        formulas=KAHAN,
    ),
    *(
        Discretization(
            name=f"Kahan, order {order}",
            title=f"Composition of Kahan maps, order {order}",
            body=Field,
            methods={f"order{order}": field_in(COMPOSITIONS[order])},
            formulas=KAHAN,
            stages=COMPOSITIONS[order],
        )
        for order in COMPOSITIONS
    ),
    Discretization(name="Map", title="Map", body=Map, methods={"auto": OWN_MAP}, formulas={}),
):
    MAPS[_record.name] = _record
