"""The records of Kahan's map of fields, and of its compositions."""

from ..bodies.fields.field import Field
from .base import MAPS, Map
from .formulas import KAHAN
from .methods import COMPOSITIONS, FIELD, field_in

for _record in (
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
            formulas=KAHAN,
            stages=COMPOSITIONS[order],
        )
        for order in COMPOSITIONS
    ),
):
    MAPS[_record.name] = _record
