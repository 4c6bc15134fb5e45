// The page that a server on this machine sends.

import { begin } from "./main.js";
import { overHttp } from "./transport.js";

begin(overHttp());
